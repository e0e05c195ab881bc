//! Specifications of machines of modules.

use super::{ACTUATORS, MOST_STATES, MOST_TRANSITIONS, Modules, SENSORS};
use crate::SpecificationError;
use crate::reader::Reader;

pub(super) fn read(reader: &mut Reader<'_>) -> Result<Modules, SpecificationError> {
    Ok(Modules {
        sensors: reader.count("sensors", SENSORS, SENSORS)?,
        actuators: reader.count("actuators", ACTUATORS, ACTUATORS)?,
        states: reader.count("states", 1, MOST_STATES)?,
        transitions: reader.count("transitions", 1, MOST_TRANSITIONS)?,
    })
}
