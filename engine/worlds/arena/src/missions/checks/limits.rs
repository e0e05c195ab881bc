//! Checks of single numbers and sections.

use serde::de::DeserializeOwned;
use serde_json::Value;
use swarmwright_simulation::ParameterError;
use swarmwright_simulation::parameters::wrong;

use crate::mistakes::part;

/// Maximum absolute coordinate, metres.
pub(super) const FARTHEST: f32 = 1000.0;

/// Checks that numbers are coordinates within `FARTHEST`.
pub(super) fn coordinates(path: &str, numbers: &[f32]) -> Result<(), ParameterError> {
    let far = |number: &&f32| number.is_nan() || number.abs() > FARTHEST;
    match numbers.iter().find(far) {
        Some(number) => Err(wrong(
            path,
            format!("{number} found, expected numbers from -{FARTHEST} to {FARTHEST}"),
        )),
        None => Ok(()),
    }
}

/// Checks that a number is a valid length.
pub(super) fn length(path: &str, number: f32) -> Result<(), ParameterError> {
    if number > 0.0 && number <= FARTHEST {
        return Ok(());
    }
    Err(wrong(
        path,
        format!("{number} found, expected a number above 0, at most {FARTHEST}"),
    ))
}

/// Reads a section that every mission must have.
pub(super) fn required<T: DeserializeOwned>(
    section: Option<&Value>,
    name: &str,
    example: &str,
) -> Result<T, ParameterError> {
    match section {
        Some(value) => part(value, &format!("mission.{name}")),
        None => Err(wrong(
            "mission",
            format!("missing field `{name}`; for instance {name}: {example}"),
        )),
    }
}
