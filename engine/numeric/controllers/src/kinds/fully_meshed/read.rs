//! Specifications of fully meshed networks.

use super::FullyMeshed;
use crate::reader::Reader;
use crate::{Activation, MAX_WEIGHTS, SpecificationError};

const ACTIVATIONS: [Activation; 4] = [
    Activation::Clamp,
    Activation::Sigmoid,
    Activation::Tanh,
    Activation::Relu,
];
const MAX_ITERATIONS: usize = 1000;

pub(super) fn read(reader: &mut Reader<'_>) -> Result<FullyMeshed, SpecificationError> {
    Ok(FullyMeshed {
        sensors: reader.count("sensors", 1, MAX_WEIGHTS)?,
        actuators: reader.count("actuators", 1, MAX_WEIGHTS)?,
        hidden: reader.count("hidden", 0, MAX_WEIGHTS)?,
        activation: reader.activation(&ACTIVATIONS)?,
        iterations: u32::try_from(reader.count("iterations", 1, MAX_ITERATIONS)?)
            .unwrap_or(u32::MAX),
        output_range: reader.output_range()?,
    })
}
