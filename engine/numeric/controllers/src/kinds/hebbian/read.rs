//! Specifications of networks with Hebbian learning.

use super::Hebbian;
use crate::reader::Reader;
use crate::{MAX_WEIGHTS, SpecificationError};

const MAX_ITERATIONS: usize = 1000;

pub(super) fn read(reader: &mut Reader<'_>) -> Result<Hebbian, SpecificationError> {
    Ok(Hebbian {
        sensors: reader.count("sensors", 1, MAX_WEIGHTS)?,
        actuators: reader.count("actuators", 1, MAX_WEIGHTS)?,
        hidden: reader.count("hidden", 0, MAX_WEIGHTS)?,
        iterations: u32::try_from(reader.count("iterations", 1, MAX_ITERATIONS)?)
            .unwrap_or(u32::MAX),
    })
}
