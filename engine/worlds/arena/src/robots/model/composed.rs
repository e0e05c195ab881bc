//! Robots composed of a body, a drive, sensors and actuators, as written in a model.

use serde::Deserialize;
use serde::de::DeserializeOwned;
use serde_json::Value;
use swarmwright_simulation::ParameterError;
use swarmwright_simulation::parameters::wrong;

use super::actuators::{self, Actuator};
use super::battery::BatteryText;
use super::drive::{self, DriveText};
use super::limits::{MASSES, within};
use super::sensors::{self, Sensor};
use crate::mistakes::{Mistakes, mismatch_at, part};
use crate::robots::robot::{FRICTION, MASS, Robot};

/// A robot as written.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct Model {
    /// Radius, metres.
    radius: f32,
    /// Height, metres; lower bodies do not hide the robot. Default: twice the radius.
    height: Option<f32>,
    /// Mass, kg.
    #[serde(default = "mass")]
    mass: f32,
    drive: Value,
    /// Coefficients of friction with other robots and with walls.
    #[serde(default = "friction")]
    friction: [f32; 2],
    battery: Option<Value>,
    #[serde(default)]
    sensors: Vec<Value>,
    #[serde(default)]
    actuators: Vec<Value>,
}

fn mass() -> f32 {
    MASS
}

fn friction() -> [f32; 2] {
    FRICTION
}

/// Reads a value that names its kind; errors begin with the path `at`.
fn parsed_kind<T: DeserializeOwned>(value: &Value, at: &str) -> Result<T, ParameterError> {
    swarmwright_values::read_kind(value).map_err(|mismatch| mismatch_at(at, mismatch))
}

/// Reads a robot. Errors name places within it. `others_send` is whether the robot may receive messages without sending
/// them.
///
/// # Errors
/// Returns all mistakes in the robot.
pub(super) fn read(value: &Value, others_send: bool) -> Result<Robot, Mistakes> {
    let model: Model = swarmwright_values::read(value).map_err(|mut mismatch| {
        if mismatch.reason == "missing field `radius`" {
            mismatch.reason +=
                "; to change a built-in robot, name it as well, such as preset: e-puck-rm1.1";
        }
        mismatch_at("", mismatch)
    })?;
    let mut mistakes = Mistakes::default();
    mistakes.take(within("mass", model.mass, MASSES));
    let Some(mut robot) = mistakes.take(body(&model)) else {
        return Err(mistakes);
    };
    let battery = |value| part::<BatteryText>(value, "battery").and_then(BatteryText::read);
    let battery = model.battery.as_ref().map(battery).transpose();
    robot.battery = mistakes.take(battery).flatten();
    for (index, actuator) in model.actuators.iter().enumerate() {
        let at = format!("actuators[{index}]");
        let read = parsed_kind::<Actuator>(actuator, &at);
        let added = read.and_then(|actuator| actuators::add(&mut robot, &actuator, &at));
        mistakes.take(added);
    }
    let before = mistakes.len();
    for (index, sensor) in model.sensors.iter().enumerate() {
        let at = format!("sensors[{index}]");
        let read = parsed_kind::<Sensor>(sensor, &at);
        // If an actuator is invalid, it is unknown whether messages are sent, so skip this check.
        let others_send = others_send || before > 0;
        let added = read.and_then(|sensor| sensors::add(&mut robot, &sensor, &at, others_send));
        mistakes.take(added);
    }
    if mistakes.len() > before {
        return Err(mistakes);
    }
    if robot.outputs.is_empty() {
        mistakes.add(wrong("sensors", "a robot needs at least one sensor"));
    }
    if robot.message > 0 && robot.links.is_none() {
        mistakes.add(wrong(
            "actuators",
            "no robot receives the message; add a sensor {kind: range_and_bearing, gives: [message]}",
        ));
    }
    mistakes.or(Some(robot))
}

/// Returns a robot without sensors.
fn body(model: &Model) -> Result<Robot, ParameterError> {
    let height = model.height.unwrap_or(2.0 * model.radius);
    let drive: DriveText = parsed_kind(&model.drive, "drive")?;
    let mut robot = drive::body(model.radius, height, model.friction, &drive)?;
    robot.mass = model.mass;
    Ok(robot)
}
