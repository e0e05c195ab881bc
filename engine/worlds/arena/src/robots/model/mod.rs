//! Robots as written: by name, as a built-in robot with changes, or composed of parts.

mod actuators;
mod battery;
mod changed;
mod composed;
mod drive;
mod limits;
mod presets;
mod radio;
mod sensors;

use serde_json::Value;
use swarmwright_simulation::parameters::wrong;

use super::robot::Robot;
use crate::mistakes::{Mistakes, with_place};

pub use presets::robots;

impl Robot {
    /// Reads a model, given as a name or an object. `path` is its path in error messages, `others_send` whether other
    /// kinds of robots send messages that it may receive.
    ///
    /// # Errors
    /// Returns all mistakes in the model.
    pub fn read(value: &Value, path: &str, others_send: bool) -> Result<Self, Mistakes> {
        let expected = || format!("the name of a robot ({}) or an object", presets::names());
        match value {
            Value::String(name) => Self::preset(name).ok_or_else(|| {
                let hint = presets::suggestion(name);
                wrong(
                    path,
                    format!("{name:?} found, expected {}{hint}", expected()),
                )
                .into()
            }),
            Value::Object(_) => {
                let read = if value.get("preset").is_some() {
                    changed::read(value).map_err(Mistakes::from)
                } else {
                    composed::read(value, others_send)
                };
                read.map_err(|mistakes| mistakes.map(|mistake| with_place(path, mistake)))
            }
            other => Err(wrong(path, format!("{other} found, expected {}", expected())).into()),
        }
    }
}
