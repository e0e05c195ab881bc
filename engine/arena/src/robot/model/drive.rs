//! Drives as they are written, and what moves with them.

use serde::Deserialize;

use super::super::presets::MASS;
use super::super::{Drive, Robot};
use super::within;
use swarmwright_simulation::ParameterError;
use swarmwright_simulation::parameters::wrong;

/// Fastest turn, rad/s: less than a half turn in a tick, noise included.
const FASTEST_TURN: f32 = 12.0;

/// What all drives have in common.
#[derive(Debug, Deserialize)]
#[serde(tag = "kind", rename_all = "snake_case", deny_unknown_fields)]
pub(super) enum DriveText {
    Differential {
        wheel_base: f32,
        max_speed: f32,
        #[serde(default = "acceleration")]
        acceleration: f32,
        #[serde(default)]
        noise: f32,
    },
    Holonomic {
        max_speed: f32,
        /// Degrees a second.
        max_turn: f32,
        #[serde(default = "acceleration")]
        acceleration: f32,
        #[serde(default)]
        noise: f32,
    },
    Car {
        wheel_base: f32,
        max_speed: f32,
        /// Degrees to either side.
        max_steering: f32,
        #[serde(default = "acceleration")]
        acceleration: f32,
        #[serde(default)]
        noise: f32,
    },
}

fn acceleration() -> f32 {
    3.75
}

/// A robot without sensors.
pub(super) fn body(
    radius: f32,
    height: f32,
    friction: [f32; 2],
    drive: &DriveText,
) -> Result<Robot, ParameterError> {
    let (kind, top_speed, acceleration, noise) = match *drive {
        DriveText::Differential {
            wheel_base,
            max_speed,
            acceleration,
            noise,
        } => {
            within("drive.wheel_base", wheel_base, [0.001, 10.0])?;
            (
                Drive::Differential { wheel_base },
                max_speed,
                acceleration,
                noise,
            )
        }
        DriveText::Holonomic {
            max_speed,
            max_turn,
            acceleration,
            noise,
        } => {
            within("drive.max_turn", max_turn, [0.0, 1000.0])?;
            let turn = max_turn.to_radians();
            (Drive::Holonomic { turn }, max_speed, acceleration, noise)
        }
        DriveText::Car {
            wheel_base,
            max_speed,
            max_steering,
            acceleration,
            noise,
        } => {
            within("drive.wheel_base", wheel_base, [0.001, 10.0])?;
            within("drive.max_steering", max_steering, [0.0, 80.0])?;
            let steering = max_steering / 180.0;
            let kind = Drive::Car {
                wheel_base,
                steering,
            };
            (kind, max_speed, acceleration, noise)
        }
    };
    // In a substep of 0.01 s bodies must not pass through each other.
    let fastest = radius * 25.0;
    if !(top_speed > 0.0 && top_speed <= fastest) {
        return Err(wrong(
            "drive.max_speed",
            format!(
                "{top_speed} found, expected a number above 0, at most 25 radii a second, {fastest}"
            ),
        ));
    }
    within("drive.acceleration", acceleration, [0.001, 1000.0])?;
    within("drive.noise", noise, [0.0, 0.2])?;
    let spin = kind.fastest_turn(top_speed);
    if spin > FASTEST_TURN {
        return Err(wrong(
            "drive",
            format!(
                "it turns by up to {spin} rad/s, at most {FASTEST_TURN} are possible; take a smaller max_speed, \
                 or a larger wheel_base"
            ),
        ));
    }
    Ok(Robot {
        radius,
        height,
        mass: MASS,
        drive: kind,
        top_speed,
        wheel_noise: noise,
        acceleration,
        friction,
        proximity: None,
        light: None,
        ground: None,
        links: None,
        around: None,
        message: 0,
        encoder_noise: 0.0,
        compass_noise: 0.0,
        outputs: Vec::new(),
    })
}
