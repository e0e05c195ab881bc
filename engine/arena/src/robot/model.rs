//! Robots as they are written: a body, a drive, and sensors and actuators by name.

use serde::Deserialize;
use serde_json::Value;

use super::{Drive, GroundSensors, LightSensors, Links, Output, Proximity, Ray, Robot, half_turns};
use swarmwright_simulation::ParameterError;
use swarmwright_simulation::parameters::wrong;

/// Most readings of a sensor that has several.
const MOST_READINGS: usize = 128;
/// Most places at which the floor is looked at.
const MOST_POINTS: usize = 8;
/// Most numbers of a message.
const MOST_NUMBERS: usize = 16;

/// Fastest turn, rad/s: less than a half turn in a tick, noise included.
const FASTEST_TURN: f32 = 12.0;

/// A robot.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct Model {
    /// Metres.
    radius: f32,
    /// Metres; what lies lower does not hide it. Default: twice the radius.
    height: Option<f32>,
    drive: DriveText,
    /// Coefficient of friction with other robots and with walls.
    #[serde(default = "friction")]
    friction: [f32; 2],
    #[serde(default)]
    sensors: Vec<Sensor>,
    #[serde(default)]
    actuators: Vec<Actuator>,
}

fn friction() -> [f32; 2] {
    [0.49, 0.07]
}

/// What all drives have in common.
#[derive(Debug, Deserialize)]
#[serde(tag = "kind", rename_all = "snake_case", deny_unknown_fields)]
enum DriveText {
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

/// What a sensor of several readings gives.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Deserialize)]
#[serde(rename_all = "snake_case")]
enum Form {
    /// Every reading.
    #[default]
    Values,
    /// The sum of the readings along their directions.
    Vector,
}

/// What ground sensors give.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Deserialize)]
#[serde(rename_all = "snake_case")]
enum Shade {
    /// Every reading.
    #[default]
    Values,
    /// Black, grey or white, by the readings of five ticks.
    Color,
}

/// What messages tell.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "snake_case")]
enum Heard {
    /// How many robots are heard.
    Count,
    /// The same as 1 - 2 / (1 + e^n).
    Squashed,
    /// The sum of 1 / (1 + range in cm) along the bearings.
    Attraction,
    /// The same in four directions.
    Sectors,
    /// The mean of the numbers sent.
    Message,
}

/// What is seen of the robots around.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "snake_case")]
enum Seen {
    Count,
    Center,
    Heading,
    Nearest,
}

#[derive(Debug, Deserialize)]
#[serde(tag = "kind", rename_all = "snake_case", deny_unknown_fields)]
enum Sensor {
    Proximity {
        count: Option<usize>,
        /// Degrees counter-clockwise from ahead.
        angles: Option<Vec<f32>>,
        /// Metres from the rim of the robot.
        range: f32,
        /// c0 + c1 d + c2 d^2 of the distance d; default: 1 at the rim, 0 at the end of the range.
        response: Option<[f32; 3]>,
        #[serde(default)]
        noise: f32,
        #[serde(default)]
        gives: Form,
    },
    Light {
        count: Option<usize>,
        angles: Option<Vec<f32>>,
        /// Distance by intensity up to which light is seen.
        #[serde(default = "reach")]
        reach: f32,
        #[serde(default)]
        noise: f32,
        #[serde(default)]
        gives: Form,
    },
    Ground {
        /// Places in the frame of the robot, metres; default: its middle.
        #[serde(default = "middle")]
        points: Vec<[f32; 2]>,
        #[serde(default)]
        noise: f32,
        #[serde(default)]
        gives: Shade,
    },
    RangeAndBearing {
        /// Metres from middle to middle.
        range: f32,
        /// Probability that a message is lost.
        #[serde(default)]
        loss: f32,
        #[serde(default = "heard")]
        gives: Vec<Heard>,
    },
    Neighbours {
        /// Metres from middle to middle.
        range: f32,
        #[serde(default = "seen")]
        gives: Vec<Seen>,
    },
    Encoders {
        #[serde(default)]
        noise: f32,
    },
    Compass {
        /// Degrees.
        #[serde(default)]
        noise: f32,
    },
    Random,
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

#[derive(Debug, Clone, Copy, Deserialize)]
#[serde(tag = "kind", rename_all = "snake_case", deny_unknown_fields)]
enum Actuator {
    /// Numbers that others hear.
    Message { numbers: usize },
}

/// Reads a robot. Complaints name places within it.
pub(super) fn read(value: &Value) -> Result<Robot, ParameterError> {
    let model: Model = serde_path_to_error::deserialize(value).map_err(|error| {
        let path = error.path().to_string();
        let name = if path == "." { "" } else { &path };
        wrong(name, error.inner().to_string())
    })?;
    within("radius", model.radius, [0.001, 10.0])?;
    let height = model.height.unwrap_or(2.0 * model.radius);
    within("height", height, [0.001, 10.0])?;
    for number in model.friction {
        within("friction", number, [0.0, 10.0])?;
    }
    let mut robot = body(model.radius, height, model.friction, &model.drive)?;
    for (index, actuator) in model.actuators.iter().enumerate() {
        let Actuator::Message { numbers } = *actuator;
        let at = format!("actuators[{index}]");
        if robot.message > 0 {
            return Err(wrong(
                &at,
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
    }
    for (index, sensor) in model.sensors.iter().enumerate() {
        add(&mut robot, sensor, &format!("sensors[{index}]"))?;
    }
    if robot.sensors() == 0 {
        return Err(wrong("sensors", "a robot needs at least one sensor"));
    }
    if robot.message > 0 && robot.links.is_none() {
        return Err(wrong(
            "actuators",
            "nobody hears the message; add a sensor {kind: range_and_bearing, gives: [message]}",
        ));
    }
    Ok(robot)
}

fn within(name: &str, number: f32, [low, high]: [f32; 2]) -> Result<(), ParameterError> {
    if (low..=high).contains(&number) {
        return Ok(());
    }
    Err(wrong(
        name,
        format!("{number} found, expected {low} to {high}"),
    ))
}

/// A robot without sensors.
fn body(
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

/// Directions in degrees, evenly spread from ahead or as they are given.
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

/// That there is no other sensor of the kind.
fn only<T>(at: &str, kind: &str, known: Option<&T>) -> Result<(), ParameterError> {
    if known.is_none() {
        return Ok(());
    }
    Err(wrong(
        at,
        format!("there is a sensor {kind} already; one of each kind is possible"),
    ))
}

fn add(robot: &mut Robot, sensor: &Sensor, at: &str) -> Result<(), ParameterError> {
    let noisy = |noise: f32| within(&format!("{at}.noise"), noise, [0.0, 1.0]);
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
            within(&format!("{at}.range"), *range, [0.001, 100.0])?;
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
            within(&format!("{at}.reach"), *reach, [0.001, 1000.0])?;
            noisy(*noise)?;
            let directions = directions(at, *count, angles.as_deref())?;
            robot.light = Some(LightSensors {
                angles: directions.into_iter().map(half_turns).collect(),
                reach: *reach,
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
        Sensor::RangeAndBearing { range, loss, gives } => {
            only(at, "range_and_bearing", robot.links.as_ref())?;
            within(&format!("{at}.range"), *range, [0.001, 1000.0])?;
            within(&format!("{at}.loss"), *loss, [0.0, 1.0])?;
            robot.links = Some(Links {
                range: *range,
                loss: *loss,
                // From rim to rim.
                offset: 200.0 * robot.radius,
            });
            for (index, heard) in gives.iter().enumerate() {
                if *heard == Heard::Message && robot.message == 0 {
                    return Err(wrong(
                        &format!("{at}.gives[{index}]"),
                        "no message is sent; add an actuator {kind: message, numbers: 1}",
                    ));
                }
                robot.outputs.push(match heard {
                    Heard::Count => Output::Neighbours,
                    Heard::Squashed => Output::NeighboursSquashed,
                    Heard::Attraction => Output::Attraction,
                    Heard::Sectors => Output::AttractionParts,
                    Heard::Message => Output::Message,
                });
            }
        }
        Sensor::Neighbours { range, gives } => {
            only(at, "neighbours", robot.around.as_ref())?;
            within(&format!("{at}.range"), *range, [0.001, 1000.0])?;
            robot.around = Some(*range);
            robot.outputs.extend(gives.iter().map(|seen| match seen {
                Seen::Count => Output::AroundCount,
                Seen::Center => Output::AroundCenter,
                Seen::Heading => Output::AroundHeading,
                Seen::Nearest => Output::AroundNearest,
            }));
        }
        Sensor::Encoders { noise } => {
            noisy(*noise)?;
            robot.encoder_noise = *noise;
            robot.outputs.push(Output::Encoders);
        }
        Sensor::Compass { noise } => {
            within(&format!("{at}.noise"), *noise, [0.0, 180.0])?;
            robot.compass_noise = *noise / 180.0;
            robot.outputs.push(Output::Compass);
        }
        Sensor::Random => robot.outputs.push(Output::Random),
    }
    Ok(())
}
