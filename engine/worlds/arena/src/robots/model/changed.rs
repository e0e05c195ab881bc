//! Built-in robots with changes. The inputs and outputs of controllers stay the same.

use serde::Deserialize;
use serde_json::Value;
use swarmwright_simulation::ParameterError;
use swarmwright_simulation::parameters::wrong;

use super::battery::BatteryText;
use super::limits::{MASSES, NOISE, RANGE, RAYS, REACH, SHARE, TURNED, within};
use super::radio::RadioText;
use super::{drive, presets};
use crate::mistakes::part;
use crate::robots::outputs::Output;
use crate::robots::parts::Drive;
use crate::robots::robot::Robot;

/// Changes of a built-in robot; omitted fields keep its values.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct Changes {
    preset: String,
    radius: Option<f32>,
    height: Option<f32>,
    mass: Option<f32>,
    friction: Option<[f32; 2]>,
    battery: Option<BatteryText>,
    #[serde(default)]
    drive: DriveChanges,
    #[serde(default)]
    sensors: SensorChanges,
}

#[derive(Debug, Default, Deserialize)]
#[serde(deny_unknown_fields)]
struct DriveChanges {
    wheel_base: Option<f32>,
    max_speed: Option<f32>,
    max_turn: Option<f32>,
    max_steering: Option<f32>,
    acceleration: Option<f32>,
    noise: Option<f32>,
}

#[derive(Debug, Default, Deserialize)]
#[serde(deny_unknown_fields)]
struct SensorChanges {
    proximity: Option<ProximityChanges>,
    light: Option<LightChanges>,
    ground: Option<NoiseChange>,
    range_and_bearing: Option<LinkChanges>,
    neighbours: Option<RangeChange>,
    encoders: Option<NoiseChange>,
    compass: Option<NoiseChange>,
}

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct ProximityChanges {
    range: Option<f32>,
    response: Option<[f32; 3]>,
    noise: Option<f32>,
}

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct LightChanges {
    reach: Option<f32>,
    noise: Option<f32>,
}

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct LinkChanges {
    range: Option<f32>,
    loss: Option<f32>,
    radio: Option<RadioText>,
}

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct RangeChange {
    range: Option<f32>,
}

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct NoiseChange {
    noise: Option<f32>,
}

/// Reads a robot that names a built-in one. Errors name places within it.
pub(super) fn read(value: &Value) -> Result<Robot, ParameterError> {
    let preset = &value["preset"];
    let mut robot = preset.as_str().and_then(Robot::preset).ok_or_else(|| {
        let hint = preset.as_str().map(presets::suggestion).unwrap_or_default();
        wrong(
            "preset",
            format!(
                "{preset} found, expected the name of a robot ({}){hint}",
                presets::names()
            ),
        )
    })?;
    check_nesting(value)?;
    let changes: Changes = part(value, "")?;
    change_body(&mut robot, &changes)?;
    change_drive(&mut robot, &changes)?;
    drive::check(&robot)?;
    change_sensors(&mut robot, &changes)?;
    robot.battery = changes.battery.map(BatteryText::read).transpose()?;
    Ok(robot)
}

/// Checks that drive and sensors are mappings, because lists would be read as their fields in order.
fn check_nesting(value: &Value) -> Result<(), ParameterError> {
    let sensors = value["sensors"].as_object().into_iter().flatten();
    let sensors = sensors.map(|(name, value)| (format!("sensors.{name}"), value));
    let parts = ["drive", "sensors", "battery"].map(|name| (name.to_owned(), &value[name]));
    for (name, part) in parts.into_iter().chain(sensors) {
        if !part.is_object() && !part.is_null() {
            let example = match name.as_str() {
                "drive" => "{noise: 0.1}",
                "battery" => "{standing: 600, driving: 300}",
                "sensors" => "{light: {noise: 0.5}}",
                _ => "{noise: 0.5}",
            };
            let form = match part {
                Value::Array(_) => "a list".to_owned(),
                other => other.to_string(),
            };
            let all = if part.is_array() && name == "sensors" {
                "; to list all sensors of a robot of your own, leave preset out"
            } else {
                ""
            };
            return Err(wrong(
                &name,
                format!(
                    "{form} found, but with preset it is a mapping of what is different, such as {example}{all}"
                ),
            ));
        }
    }
    Ok(())
}

/// Sets the target, if there is a value.
fn put<T: Copy>(target: &mut T, value: Option<T>) {
    if let Some(value) = value {
        *target = value;
    }
}

/// Sets the target, if there is a value, after checking its limits.
fn put_within(
    target: &mut f32,
    value: Option<f32>,
    name: &str,
    limits: [f32; 2],
) -> Result<(), ParameterError> {
    if let Some(value) = value {
        within(name, value, limits)?;
        *target = value;
    }
    Ok(())
}

fn change_body(robot: &mut Robot, changes: &Changes) -> Result<(), ParameterError> {
    if let Some(radius) = changes.radius {
        // Rays keep their distance from the rim.
        let more = radius - robot.radius;
        if let Some(proximity) = &mut robot.proximity {
            proximity.start += more;
        }
        robot.radius = radius;
    }
    put(&mut robot.height, changes.height);
    put(&mut robot.friction, changes.friction);
    put_within(&mut robot.mass, changes.mass, "mass", MASSES)
}

fn change_drive(robot: &mut Robot, changes: &Changes) -> Result<(), ParameterError> {
    let DriveChanges {
        wheel_base,
        max_speed,
        max_turn,
        max_steering,
        acceleration,
        noise,
    } = changes.drive;
    put(&mut robot.top_speed, max_speed);
    put(&mut robot.acceleration, acceleration);
    put(&mut robot.wheel_noise, noise);
    let max_turn = max_turn.map(drive::turn).transpose()?;
    let max_steering = max_steering.map(drive::steering).transpose()?;
    let (kind, useless) = match &mut robot.drive {
        Drive::Differential { wheel_base: base } => {
            put(base, wheel_base);
            let useless = [("max_turn", max_turn), ("max_steering", max_steering)];
            ("differential", useless)
        }
        Drive::Holonomic { turn } => {
            put(turn, max_turn);
            let useless = [("wheel_base", wheel_base), ("max_steering", max_steering)];
            ("holonomic", useless)
        }
        Drive::Car {
            wheel_base: base,
            steering,
        } => {
            put(base, wheel_base);
            put(steering, max_steering);
            ("car", [("max_turn", max_turn), ("", None)])
        }
    };
    match useless.iter().find(|(_, value)| value.is_some()) {
        Some((name, _)) => Err(wrong(
            &format!("drive.{name}"),
            format!("the drive of {} is {kind}, which has none", changes.preset),
        )),
        None => Ok(()),
    }
}

fn change_sensors(robot: &mut Robot, changes: &Changes) -> Result<(), ParameterError> {
    let sensors = &changes.sensors;
    let present = kinds(robot);
    let changed = [
        ("proximity", sensors.proximity.is_some()),
        ("light", sensors.light.is_some()),
        ("ground", sensors.ground.is_some()),
        ("range_and_bearing", sensors.range_and_bearing.is_some()),
        ("neighbours", sensors.neighbours.is_some()),
        ("encoders", sensors.encoders.is_some()),
        ("compass", sensors.compass.is_some()),
    ];
    for (name, is_changed) in changed {
        if is_changed && !present.contains(&name) {
            let (preset, present) = (&changes.preset, present.join(", "));
            return Err(wrong(
                &format!("sensors.{name}"),
                format!("{preset} has no such sensor; it has {present}"),
            ));
        }
    }
    if let (Some(part), Some(change)) = (&mut robot.proximity, &sensors.proximity) {
        if let Some(range) = change.range {
            within("sensors.proximity.range", range, RAYS)?;
            // Readings stay the same at equal fractions of the range.
            let share = part.range / range;
            part.response[1] *= share;
            part.response[2] *= share * share;
            part.range = range;
        }
        put(&mut part.response, change.response);
        put_within(
            &mut part.noise,
            change.noise,
            "sensors.proximity.noise",
            NOISE,
        )?;
    }
    if let (Some(part), Some(change)) = (&mut robot.light, &sensors.light) {
        put_within(&mut part.reach, change.reach, "sensors.light.reach", REACH)?;
        put_within(&mut part.noise, change.noise, "sensors.light.noise", NOISE)?;
    }
    if let (Some(part), Some(change)) = (&mut robot.ground, &sensors.ground) {
        put_within(&mut part.noise, change.noise, "sensors.ground.noise", NOISE)?;
    }
    if let (Some(part), Some(change)) = (&mut robot.links, &sensors.range_and_bearing) {
        let name = "sensors.range_and_bearing";
        put_within(
            &mut part.range,
            change.range,
            &format!("{name}.range"),
            RANGE,
        )?;
        put_within(&mut part.loss, change.loss, &format!("{name}.loss"), SHARE)?;
        if let Some(radio) = change.radio {
            radio.put(part, &format!("{name}.radio"))?;
        }
    }
    if let (Some(range), Some(change)) = (&mut robot.neighbour_range, &sensors.neighbours) {
        put_within(range, change.range, "sensors.neighbours.range", RANGE)?;
    }
    if let Some(change) = &sensors.encoders {
        let noise = &mut robot.encoder_noise;
        put_within(noise, change.noise, "sensors.encoders.noise", NOISE)?;
    }
    if let Some(noise) = sensors.compass.as_ref().and_then(|change| change.noise) {
        within("sensors.compass.noise", noise, TURNED)?;
        robot.compass_noise = noise / 180.0;
    }
    Ok(())
}

/// Returns the kinds of the robot's sensors that can be changed.
fn kinds(robot: &Robot) -> Vec<&'static str> {
    let has = |output| robot.outputs.contains(&output);
    let kinds = [
        ("proximity", robot.proximity.is_some()),
        ("light", robot.light.is_some()),
        ("ground", robot.ground.is_some()),
        ("range_and_bearing", robot.links.is_some()),
        ("neighbours", robot.neighbour_range.is_some()),
        ("encoders", has(Output::Encoders)),
        ("compass", has(Output::Compass)),
    ];
    let present = kinds.into_iter().filter(|(_, present)| *present);
    present.map(|(name, _)| name).collect()
}
