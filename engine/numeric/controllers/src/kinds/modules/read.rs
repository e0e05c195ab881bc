//! Specifications of machines of modules.

use super::{ACTUATORS, Form, MOST_STATES, MOST_TRANSITIONS, Modules, SENSORS};
use crate::SpecificationError;
use crate::reader::Reader;

pub(super) fn read(reader: &mut Reader<'_>) -> Result<Modules, SpecificationError> {
    let form = [Form::Machine, Form::Tree][reader.choice("form", &["machine", "tree"])?];
    // Each subtree draws a random number of its own.
    let (states, transitions) = match form {
        Form::Machine => (MOST_STATES, MOST_TRANSITIONS),
        Form::Tree => (MOST_TRANSITIONS, 1),
    };
    Ok(Modules {
        form,
        sensors: reader.count("sensors", SENSORS, SENSORS)?,
        actuators: reader.count("actuators", ACTUATORS, ACTUATORS)?,
        states: reader.count("states", 1, states)?,
        transitions: reader.count("transitions", 1, transitions)?,
    })
}
