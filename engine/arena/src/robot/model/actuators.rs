//! Actuators beside the drive, as they are written.

use serde::Deserialize;

use super::super::Robot;
use swarmwright_simulation::ParameterError;
use swarmwright_simulation::parameters::wrong;

/// Most numbers of a message.
const MOST_NUMBERS: usize = 16;

#[derive(Debug, Clone, Copy, Deserialize)]
#[serde(tag = "kind", rename_all = "snake_case", deny_unknown_fields)]
pub(super) enum Actuator {
    /// Numbers that others hear.
    Message { numbers: usize },
}

/// Gives a robot an actuator; `at` is what it is called in complaints.
pub(super) fn add(robot: &mut Robot, actuator: Actuator, at: &str) -> Result<(), ParameterError> {
    let Actuator::Message { numbers } = actuator;
    if robot.message > 0 {
        return Err(wrong(
            at,
            "there is a message already; give it more numbers",
        ));
    }
    if !(1..=MOST_NUMBERS).contains(&numbers) {
        return Err(wrong(
            &format!("{at}.numbers"),
            format!("{numbers} found, expected 1 to {MOST_NUMBERS}"),
        ));
    }
    robot.message = numbers;
    Ok(())
}
