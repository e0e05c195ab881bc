//! Specifications of networks with given connections.

use super::Neat;
use crate::reader::{Reader, wrong};
use crate::{MAX_WEIGHTS, SpecificationError};

const MAX_ITERATIONS: usize = 1000;

pub(super) fn read(reader: &mut Reader<'_>) -> Result<Neat, SpecificationError> {
    let sensors = reader.count("sensors", 1, MAX_WEIGHTS)?;
    let actuators = reader.count("actuators", 1, MAX_WEIGHTS)?;
    let sources = reader.lists("sources", |rows| (sensors + rows).saturating_sub(1))?;
    if sources.len() < actuators {
        return Err(wrong(
            "sources",
            format!(
                "{} lists found, expected one for each hidden node and each of the {actuators} actuators",
                sources.len()
            ),
        ));
    }
    Ok(Neat {
        sensors,
        actuators,
        sources,
        iterations: u32::try_from(reader.count("iterations", 1, MAX_ITERATIONS)?)
            .unwrap_or(u32::MAX),
    })
}
