//! Specifications of networks that grow.

use super::{Growing, NodeActivation};
use crate::reader::{Reader, wrong};
use crate::{MAX_WEIGHTS, SpecificationError};

pub(super) fn read(reader: &mut Reader<'_>) -> Result<Growing, SpecificationError> {
    Ok(Growing {
        sensors: reader.count("sensors", 1, MAX_WEIGHTS)?,
        actuators: reader.count("actuators", 1, MAX_WEIGHTS)?,
        nodes: reader.count("nodes", 0, MAX_WEIGHTS)?,
        connections: reader.count("connections", 1, MAX_WEIGHTS)?,
        recurrent: reader.read("recurrent", "true or false")?,
        output_activation: activation(reader)?,
        output_range: reader.output_range()?,
    })
}

fn activation(reader: &mut Reader<'_>) -> Result<NodeActivation, SpecificationError> {
    let names = NodeActivation::ALL.map(NodeActivation::name);
    let expected = format!("one of {}", names.join(", "));
    let text = reader.text("output_activation", &expected)?;
    let activation = NodeActivation::ALL.into_iter().find(|a| a.name() == text);
    activation.ok_or_else(|| {
        wrong(
            "output_activation",
            format!("{text:?} found, expected {expected}"),
        )
    })
}
