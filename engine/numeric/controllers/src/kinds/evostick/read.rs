//! Specifications of EvoStick's networks.

use super::Evostick;
use crate::reader::Reader;
use crate::{MAX_WEIGHTS, SpecificationError};

pub(super) fn read(reader: &mut Reader<'_>) -> Result<Evostick, SpecificationError> {
    Ok(Evostick {
        sensors: reader.count("sensors", 1, MAX_WEIGHTS)?,
        actuators: reader.count("actuators", 1, MAX_WEIGHTS)?,
    })
}
