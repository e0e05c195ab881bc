//! Actuators other than the drive, as written in a model.

use serde::Deserialize;
use swarmwright_simulation::ParameterError;
use swarmwright_simulation::parameters::wrong;

use super::limits::{each_once, within};
use crate::place::LedColor;
use crate::robots::robot::Robot;

/// Maximum number of values in a message.
const MOST_NUMBERS: usize = 16;

#[derive(Debug, Clone, Deserialize)]
#[serde(rename_all = "snake_case", deny_unknown_fields)]
pub(super) enum Actuator {
    /// Values that other robots receive.
    Message { numbers: usize },
    /// One number for each colour that the robot can show.
    Led { colors: Vec<LedColor> },
    /// A gripper, which holds an object while its number is above 0.
    Gripper {
        /// Maximum gap between the rims of the robot and the object, metres.
        #[serde(default = "reach")]
        reach: f32,
    },
}

fn reach() -> f32 {
    0.01
}

/// Limits of a gripper's reach, metres, so that a held object is in contact.
const REACHES: [f32; 2] = [0.001, 0.02];

/// Adds an actuator to a robot; `at` is its path in error messages.
pub(super) fn add(robot: &mut Robot, actuator: &Actuator, at: &str) -> Result<(), ParameterError> {
    match actuator {
        Actuator::Message { numbers } => {
            if robot.message > 0 {
                return Err(wrong(at, "a message already exists; give it more numbers"));
            }
            if !(1..=MOST_NUMBERS).contains(numbers) {
                return Err(wrong(
                    &format!("{at}.numbers"),
                    format!("{numbers} found, expected 1 to {MOST_NUMBERS}"),
                ));
            }
            robot.message = *numbers;
        }
        Actuator::Led { colors } => {
            if !robot.leds.is_empty() {
                return Err(wrong(at, "an LED already exists; give it more colors"));
            }
            each_once(&format!("{at}.colors"), colors)?;
            robot.leds.clone_from(colors);
        }
        Actuator::Gripper { reach } => {
            if robot.gripper.is_some() {
                return Err(wrong(
                    at,
                    "a gripper already exists; a robot has at most one",
                ));
            }
            within(&format!("{at}.reach"), *reach, REACHES)?;
            robot.gripper = Some(*reach);
        }
    }
    Ok(())
}
