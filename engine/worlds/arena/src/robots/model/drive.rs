//! Drives, as written in a model, and the bodies that they move.

use serde::Deserialize;
use swarmwright_simulation::ParameterError;
use swarmwright_simulation::parameters::wrong;

use super::limits::within;
use crate::robots::parts::Drive;
use crate::robots::robot::{ACCELERATION, Robot};

/// Maximum turn rate, rad/s: less than half a turn per tick, with noise.
const FASTEST_TURN: f32 = 12.0;

/// A drive as written.
#[derive(Debug, Deserialize)]
#[serde(rename_all = "snake_case", deny_unknown_fields)]
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
        /// Degrees per second.
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
    ACCELERATION
}

/// Converts degrees per second to rad/s.
pub(super) fn turn(degrees: f32) -> Result<f32, ParameterError> {
    within("drive.max_turn", degrees, [0.0, 1000.0])?;
    Ok(degrees.to_radians())
}

/// Converts degrees to half turns.
pub(super) fn steering(degrees: f32) -> Result<f32, ParameterError> {
    within("drive.max_steering", degrees, [0.0, 80.0])?;
    Ok(degrees / 180.0)
}

/// Returns a robot without sensors.
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
            let kind = Drive::Differential { wheel_base };
            (kind, max_speed, acceleration, noise)
        }
        DriveText::Holonomic {
            max_speed,
            max_turn,
            acceleration,
            noise,
        } => {
            let turn = turn(max_turn)?;
            (Drive::Holonomic { turn }, max_speed, acceleration, noise)
        }
        DriveText::Car {
            wheel_base,
            max_speed,
            max_steering,
            acceleration,
            noise,
        } => {
            let steering = steering(max_steering)?;
            let kind = Drive::Car {
                wheel_base,
                steering,
            };
            (kind, max_speed, acceleration, noise)
        }
    };
    let robot = Robot {
        wheel_noise: noise,
        acceleration,
        friction,
        ..Robot::bare(radius, height, kind, top_speed)
    };
    check(&robot)?;
    Ok(robot)
}

/// Checks body and drive, whose limits depend on each other.
pub(super) fn check(robot: &Robot) -> Result<(), ParameterError> {
    within("radius", robot.radius, [0.001, 10.0])?;
    within("height", robot.height, [0.001, 10.0])?;
    for number in robot.friction {
        within("friction", number, [0.0, 10.0])?;
    }
    if let Drive::Differential { wheel_base } | Drive::Car { wheel_base, .. } = robot.drive {
        within("drive.wheel_base", wheel_base, [0.001, 10.0])?;
    }
    // Bodies must not pass through each other within a substep of 0.01 s.
    let (top_speed, fastest) = (robot.top_speed, robot.radius * 25.0);
    if !(top_speed > 0.0 && top_speed <= fastest) {
        return Err(wrong(
            "drive.max_speed",
            format!(
                "{top_speed} found, expected a number above 0, at most 25 radii a second, {fastest}"
            ),
        ));
    }
    within("drive.acceleration", robot.acceleration, [0.001, 1000.0])?;
    within("drive.noise", robot.wheel_noise, [0.0, 0.2])?;
    let spin = robot.drive.fastest_turn(top_speed);
    if spin > FASTEST_TURN {
        return Err(wrong(
            "drive",
            format!(
                "it turns by up to {spin} rad/s, at most {FASTEST_TURN} are possible; use a smaller max_speed or a larger \
                 wheel_base"
            ),
        ));
    }
    Ok(())
}
