//! Sensors, as written in a model.

use serde::Deserialize;
use swarmwright_simulation::ParameterError;
use swarmwright_simulation::parameters::wrong;

use super::limits::{NOISE, RANGE, RAYS, REACH, SHARE, TURNED, each_once, within};
use super::radio::RadioText;
use crate::place::LedColor;
use crate::robots::outputs::Output;
use crate::robots::parts::{
    Camera, GroundSensors, LightSensors, Links, Proximity, Ray, Sight, half_turns,
};
use crate::robots::robot::Robot;

/// Maximum number of readings of a sensor.
const MOST_READINGS: usize = 128;
/// Maximum number of points at which the floor is sensed.
const MOST_POINTS: usize = 8;

/// The output of a sensor with several readings.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Deserialize)]
#[serde(rename_all = "snake_case")]
pub(super) enum Form {
    /// Every reading.
    #[default]
    Values,
    /// The sum of the readings as vectors along their directions.
    Vector,
}

/// The output of ground sensors.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Deserialize)]
#[serde(rename_all = "snake_case")]
pub(super) enum Shade {
    /// Every reading.
    #[default]
    Values,
    /// Black, grey or white, by the readings of the last five ticks.
    Color,
}

/// A quantity derived from received messages.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "snake_case")]
pub(super) enum Heard {
    /// The number n of messages.
    Count,
    /// The number of messages, squashed to 1 - 2 / (1 + e^n).
    Squashed,
    /// The sum of 1 / (1 + range in cm) along the bearings.
    Attraction,
    /// The components of the attraction in four directions.
    Sectors,
    /// The mean of the numbers sent.
    Message,
}

/// A quantity that the sensor `neighbours` measures.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "snake_case")]
pub(super) enum Seen {
    Count,
    Center,
    Heading,
    Nearest,
}

/// A sensor as written.
#[derive(Debug, Deserialize)]
#[serde(rename_all = "snake_case", deny_unknown_fields)]
pub(super) enum Sensor {
    Proximity {
        count: Option<usize>,
        /// Directions, degrees counter-clockwise from ahead.
        angles: Option<Vec<f32>>,
        /// Range from the rim of the robot, metres.
        range: f32,
        /// Coefficients of the reading c0 + c1 d + c2 d^2 at distance d. Default: 1 at the rim, 0 at the end of the
        /// range.
        response: Option<[f32; 3]>,
        #[serde(default)]
        noise: f32,
        #[serde(default)]
        gives: Form,
    },
    Light {
        count: Option<usize>,
        angles: Option<Vec<f32>>,
        /// Distance divided by intensity up to which light is detected.
        #[serde(default = "reach")]
        reach: f32,
        #[serde(default)]
        noise: f32,
        #[serde(default)]
        gives: Form,
    },
    Ground {
        /// Positions in the frame of the robot, metres. Default: its middle.
        #[serde(default = "middle")]
        points: Vec<[f32; 2]>,
        #[serde(default)]
        noise: f32,
        #[serde(default)]
        gives: Shade,
    },
    RangeAndBearing {
        /// Maximum distance, metres from middle to middle.
        range: f32,
        /// Probability that a message is lost.
        #[serde(default)]
        loss: f32,
        radio: Option<RadioText>,
        #[serde(default = "heard")]
        gives: Vec<Heard>,
    },
    Neighbours {
        /// Maximum distance, metres from middle to middle.
        range: f32,
        #[serde(default = "seen")]
        gives: Vec<Seen>,
    },
    Encoders {
        #[serde(default)]
        noise: f32,
    },
    Compass {
        /// Half-width of the uniform noise, degrees.
        #[serde(default)]
        noise: f32,
    },
    Random {},
    Camera {
        /// Maximum distance, metres from middle to middle.
        range: f32,
        /// Half-width of the uniform noise of each direction, degrees.
        #[serde(default)]
        noise: f32,
        colors: Vec<LedColor>,
        #[serde(default = "sights")]
        gives: Vec<Sight>,
    },
    Battery {
        #[serde(default)]
        noise: f32,
    },
    /// Reports whether the robot carries a flag.
    Flag {},
    /// Reports whether the gripper holds an object.
    Gripper {},
}

fn sights() -> Vec<Sight> {
    vec![Sight::Count, Sight::Attraction]
}

fn reach() -> f32 {
    2.5
}

fn middle() -> Vec<[f32; 2]> {
    vec![[0.0; 2]]
}

fn heard() -> Vec<Heard> {
    vec![Heard::Count, Heard::Attraction]
}

fn seen() -> Vec<Seen> {
    vec![Seen::Count, Seen::Center]
}

/// Returns directions in degrees, either evenly spaced from ahead or as given.
fn directions(
    at: &str,
    count: Option<usize>,
    angles: Option<&[f32]>,
) -> Result<Vec<f32>, ParameterError> {
    let directions = match (count, angles) {
        (Some(count), None) => {
            if !(1..=MOST_READINGS).contains(&count) {
                return Err(wrong(
                    &format!("{at}.count"),
                    format!("{count} found, expected 1 to {MOST_READINGS}"),
                ));
            }
            (0..count)
                .map(|index| 360.0 * index as f32 / count as f32)
                .collect()
        }
        (None, Some(angles)) if (1..=MOST_READINGS).contains(&angles.len()) => angles.to_vec(),
        _ => {
            return Err(wrong(
                at,
                format!("expected count, or angles, 1 to {MOST_READINGS} of them"),
            ));
        }
    };
    for angle in &directions {
        within(&format!("{at}.angles"), *angle, [-360.0, 360.0])?;
    }
    let positive = |angle: f32| if angle < 0.0 { angle + 360.0 } else { angle };
    Ok(directions.into_iter().map(positive).collect())
}

/// Checks that the robot has no other sensor of this kind.
fn only<T>(at: &str, kind: &str, existing: Option<&T>) -> Result<(), ParameterError> {
    if existing.is_none() {
        return Ok(());
    }
    Err(wrong(
        at,
        format!("a sensor {kind} already exists; a robot has at most one of each kind"),
    ))
}

/// Adds a sensor to a robot. `at` is its path in error messages, `others_send` whether other kinds of robots send
/// messages.
pub(super) fn add(
    robot: &mut Robot,
    sensor: &Sensor,
    at: &str,
    others_send: bool,
) -> Result<(), ParameterError> {
    let noisy = |noise: f32| within(&format!("{at}.noise"), noise, NOISE);
    let add_only = |robot: &mut Robot, output: Output, kind: &str| {
        let existing = robot.outputs.iter().find(|existing| **existing == output);
        only(at, kind, existing)?;
        robot.outputs.push(output);
        Ok(())
    };
    match sensor {
        Sensor::Proximity {
            count,
            angles,
            range,
            response,
            noise,
            gives,
        } => {
            only(at, "proximity", robot.proximity.as_ref())?;
            within(&format!("{at}.range"), *range, RAYS)?;
            noisy(*noise)?;
            let directions = directions(at, *count, angles.as_deref())?;
            let ray = |degrees: f32| {
                let (sin, cos) = f64::from(degrees).to_radians().sin_cos();
                Ray {
                    along: [cos as f32, sin as f32],
                    reported: half_turns(degrees),
                }
            };
            robot.proximity = Some(Proximity {
                rays: directions.into_iter().map(ray).collect(),
                opposed: count.is_some_and(|count| count % 2 == 0),
                start: robot.radius,
                blind_inside: false,
                range: *range,
                response: response.unwrap_or([1.0, -1.0 / range, 0.0]),
                noise: *noise,
            });
            robot.outputs.push(match gives {
                Form::Values => Output::Proximity,
                Form::Vector => Output::ProximityVector,
            });
        }
        Sensor::Light {
            count,
            angles,
            reach,
            noise,
            gives,
        } => {
            only(at, "light", robot.light.as_ref())?;
            within(&format!("{at}.reach"), *reach, REACH)?;
            noisy(*noise)?;
            let directions = directions(at, *count, angles.as_deref())?;
            robot.light = Some(LightSensors {
                angles: directions.into_iter().map(half_turns).collect(),
                reach: *reach,
                shadow: 0.0,
                noise: *noise,
            });
            robot.outputs.push(match gives {
                Form::Values => Output::Light,
                Form::Vector => Output::LightDirection,
            });
        }
        Sensor::Ground {
            points,
            noise,
            gives,
        } => {
            only(at, "ground", robot.ground.as_ref())?;
            noisy(*noise)?;
            if !(1..=MOST_POINTS).contains(&points.len()) {
                return Err(wrong(
                    &format!("{at}.points"),
                    format!("{} found, expected 1 to {MOST_POINTS}", points.len()),
                ));
            }
            for number in points.as_flattened() {
                within(&format!("{at}.points"), *number, [-10.0, 10.0])?;
            }
            robot.ground = Some(GroundSensors {
                points: points.clone(),
                noise: *noise,
            });
            robot.outputs.push(match gives {
                Shade::Values => Output::GroundReadings,
                Shade::Color => Output::Ground,
            });
        }
        Sensor::RangeAndBearing {
            range,
            loss,
            radio,
            gives,
        } => {
            only(at, "range_and_bearing", robot.links.as_ref())?;
            within(&format!("{at}.range"), *range, RANGE)?;
            within(&format!("{at}.loss"), *loss, SHARE)?;
            let mut links = Links {
                range: *range,
                loss: *loss,
                radio: None,
            };
            if let Some(radio) = radio {
                radio.put(&mut links, &format!("{at}.radio"))?;
            }
            each_once(&format!("{at}.gives"), gives)?;
            robot.links = Some(links);
            for (index, heard) in gives.iter().enumerate() {
                if *heard == Heard::Message && robot.message == 0 && !others_send {
                    return Err(wrong(
                        &format!("{at}.gives[{index}]"),
                        "no message is sent; add an actuator {kind: message, numbers: 1}",
                    ));
                }
                robot.outputs.push(match heard {
                    Heard::Count => Output::MessageCount,
                    Heard::Squashed => Output::MessageCountSquashed,
                    Heard::Attraction => Output::Attraction,
                    Heard::Sectors => Output::AttractionParts,
                    Heard::Message => Output::Message,
                });
            }
        }
        Sensor::Neighbours { range, gives } => {
            only(at, "neighbours", robot.neighbour_range.as_ref())?;
            within(&format!("{at}.range"), *range, RANGE)?;
            each_once(&format!("{at}.gives"), gives)?;
            robot.neighbour_range = Some(*range);
            robot
                .outputs
                .extend(gives.iter().map(|quantity| match quantity {
                    Seen::Count => Output::NeighbourCount,
                    Seen::Center => Output::NeighbourCenter,
                    Seen::Heading => Output::NeighbourHeading,
                    Seen::Nearest => Output::NeighbourNearest,
                }));
        }
        Sensor::Encoders { noise } => {
            noisy(*noise)?;
            robot.encoder_noise = *noise;
            add_only(robot, Output::Encoders, "encoders")?;
        }
        Sensor::Compass { noise } => {
            within(&format!("{at}.noise"), *noise, TURNED)?;
            robot.compass_noise = *noise / 180.0;
            add_only(robot, Output::Compass, "compass")?;
        }
        Sensor::Flag {} => add_only(robot, Output::Flag, "flag")?,
        Sensor::Random {} => add_only(robot, Output::Random, "random")?,
        Sensor::Camera {
            range,
            noise,
            colors,
            gives,
        } => {
            only(at, "camera", robot.camera.as_ref())?;
            within(&format!("{at}.range"), *range, RANGE)?;
            within(&format!("{at}.noise"), *noise, TURNED)?;
            each_once(&format!("{at}.colors"), colors)?;
            each_once(&format!("{at}.gives"), gives)?;
            robot.camera = Some(Camera {
                range: *range,
                noise: *noise / 180.0,
                colors: colors.clone(),
                gives: gives.clone(),
            });
            robot.outputs.push(Output::Camera);
        }
        Sensor::Gripper {} => {
            if robot.gripper.is_none() {
                return Err(wrong(
                    at,
                    "the robot has no gripper; add the actuator {kind: gripper}",
                ));
            }
            add_only(robot, Output::Gripper, "gripper")?;
        }
        Sensor::Battery { noise } => {
            if robot.battery.is_none() {
                return Err(wrong(
                    at,
                    "the robot has no battery; add battery: {standing: 600, driving: 300}, seconds that it lasts",
                ));
            }
            noisy(*noise)?;
            robot.battery_noise = *noise;
            add_only(robot, Output::Battery, "battery")?;
        }
    }
    Ok(())
}
