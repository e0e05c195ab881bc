//! Specifications of layered networks.

use super::Layered;
use crate::reader::Reader;
use crate::{Activation, MAX_WEIGHTS, SpecificationError};

pub(super) fn read(reader: &mut Reader<'_>) -> Result<Layered, SpecificationError> {
    Ok(Layered {
        sensors: reader.count("sensors", 1, MAX_WEIGHTS)?,
        actuators: reader.count("actuators", 1, MAX_WEIGHTS)?,
        hidden: reader.counts("hidden", 1, MAX_WEIGHTS)?,
        activation: reader.activation(&Activation::ALL)?,
        output_activation: reader.output_activation(&Activation::ALL)?,
        output_range: reader.output_range()?,
    })
}
