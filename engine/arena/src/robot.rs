//! Models of robots: body, drive, sensors, and what controllers get of them.

mod model;

use serde_json::Value;

use super::settings::with_place;
use swarmwright_simulation::ParameterError;
use swarmwright_simulation::parameters::wrong;

/// A ray in the frame of the robot, x ahead, y to the left.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Ray {
    /// Unit vector.
    pub along: [f32; 2],
    /// The angle that controllers are told, half turns counter-clockwise from ahead.
    pub reported: f32,
}

/// Proximity sensors: rays that see bodies and walls.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Proximity {
    pub rays: Vec<Ray>,
    /// Whether each ray of the first half has its opposite in the second one: what one of them meets the other does not.
    pub opposed: bool,
    /// Where rays begin, metres from the middle.
    pub start: f32,
    /// How far they see from there, metres.
    pub range: f32,
    /// A reading is c0 + c1 d + c2 d^2 of the distance d, limited to 0..=1.
    pub response: [f32; 3],
    /// Uniform noise of +-this, after which the reading is limited again.
    pub noise: f32,
}

impl Proximity {
    /// Rays of which one in each pair of opposites is, else all.
    #[inline(always)]
    pub(super) fn halves(&self) -> usize {
        if self.opposed {
            self.rays.len() / 2
        } else {
            self.rays.len()
        }
    }

    /// The ray opposite to one of the first half.
    #[inline(always)]
    pub(super) fn opposite(&self, ray: usize) -> Option<usize> {
        self.opposed.then_some(ray + self.rays.len() / 2)
    }
}

/// Light sensors.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct LightSensors {
    /// Half turns counter-clockwise from ahead.
    pub angles: Vec<f32>,
    /// Distance divided by intensity up to which light is seen.
    pub reach: f32,
    /// Uniform noise.
    pub noise: f32,
}

/// Sensors that look at the floor.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct GroundSensors {
    /// Places in the frame of the robot, metres.
    pub points: Vec<[f32; 2]>,
    /// Uniform noise.
    pub noise: f32,
}

/// Range and bearing of neighbours.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Links {
    /// Largest distance of middles, metres.
    pub range: f32,
    /// Probability that a message is lost, drawn for each link and tick.
    pub loss: f32,
    /// What is subtracted from the distance, centimetres.
    pub offset: f32,
}

/// How a robot moves.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum Drive {
    /// Two wheels, left and right, this far apart, metres.
    Differential { wheel_base: f32 },
    /// In any direction, ahead and to the left, while it turns by up to this, rad/s.
    Holonomic { turn: f32 },
    /// A speed and the angle of the front wheels, up to this many half turns to either side; axles this far apart, metres.
    Car { wheel_base: f32, steering: f32 },
}

impl Drive {
    fn actuators(self) -> &'static [&'static str] {
        match self {
            Self::Differential { .. } => &["left wheel", "right wheel"],
            Self::Holonomic { .. } => &["ahead", "left", "turn"],
            Self::Car { .. } => &["speed", "steering"],
        }
    }

    /// rad/s, at a speed of the wheels or of the robot.
    fn fastest_turn(self, speed: f32) -> f32 {
        match self {
            Self::Differential { wheel_base } => 2.0 * speed / wheel_base,
            Self::Holonomic { turn } => turn,
            Self::Car {
                wheel_base,
                steering,
            } => speed * (steering * std::f32::consts::PI).tan() / wheel_base,
        }
    }
}

/// Numbers that controllers get, in the order of a model's list.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Output {
    /// The reading of each proximity sensor, 0..=1.
    Proximity,
    /// The sum of proximity readings along their rays, at most of length 1: x, y.
    ProximityVector,
    /// The reading of each light sensor, 0..=1.
    Light,
    /// The direction of light, of length 1, or 0, 0 where no reading is above 0.2: x, y.
    LightDirection,
    /// Three numbers: 0 on black, 1 on white, and on grey draws around 0.407, 0.342 and 0.423.
    GroundDrawn,
    /// 0 on black, 0.5 on grey, 1 on white.
    Ground,
    /// Number of robots heard in this tick.
    Neighbours,
    /// 1 - 2 / (1 + e^n) of the robots n heard in this tick.
    NeighboursSquashed,
    /// Sum of 1 / (1 + range in cm) along the bearings of the messages of the last 11 ticks: x, y.
    Attraction,
    /// The same, squashed to the length tanh(length / 2), along 45, 135, 225 and 315 degrees; 0 where that is negative.
    AttractionParts,
    /// A number in 0..1, drawn anew in each tick.
    Random,
    /// The reading of each ground sensor, 0 black to 1 white.
    GroundReadings,
    /// The mean of the messages heard in this tick, number by number; 0 where none is heard.
    Message,
    /// Number of robots within the range of `around`.
    AroundCount,
    /// Mean of the positions of those robots in the robot's frame, in ranges: x, y; 0, 0 where there is none.
    AroundCenter,
    /// Mean of their headings in the robot's frame as unit vectors: x, y.
    AroundHeading,
    /// The nearest of them in the robot's frame, in ranges: x, y.
    AroundNearest,
    /// What the drive aimed at in the tick before, with its noise: for each actuator of the drive a share of the largest
    /// speed.
    Encoders,
    /// The direction of the x axis in the robot's frame as a unit vector: x, y.
    Compass,
}

/// A model of a robot.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Robot {
    /// Metres.
    pub radius: f32,
    /// Metres; what lies lower does not hide it.
    pub height: f32,
    pub drive: Drive,
    /// Largest speed of a wheel or of the robot, m/s: actuators of 1.
    pub top_speed: f32,
    /// Standard deviation of the factor by which the speed of a wheel is off in a tick.
    pub wheel_noise: f32,
    /// Largest change of velocity by the drive, m/s^2.
    pub acceleration: f32,
    /// Coefficient of friction between robots, and with walls.
    pub friction: [f32; 2],
    pub proximity: Option<Proximity>,
    pub light: Option<LightSensors>,
    pub ground: Option<GroundSensors>,
    pub links: Option<Links>,
    /// How far robots see others without loss or hiding, metres.
    pub around: Option<f32>,
    /// Numbers of a message, actuators of their own.
    pub message: usize,
    /// Uniform noise of the encoders.
    pub encoder_noise: f32,
    /// Uniform noise of the compass, half turns.
    pub compass_noise: f32,
    pub outputs: Vec<Output>,
}

/// Seconds.
const TICK: f32 = 0.1;

/// Models that are composed: a file each.
const MODELS: [(&str, &str); 4] = [
    ("foot-bot", include_str!("robots/foot-bot.yaml")),
    ("kilobot", include_str!("robots/kilobot.yaml")),
    ("point", include_str!("robots/point.yaml")),
    ("turtlebot3", include_str!("robots/turtlebot3.yaml")),
];

/// Degrees in half turns.
const fn half_turns(degrees: f32) -> f32 {
    if degrees > 180.0 {
        (degrees - 360.0) / 180.0
    } else {
        degrees / 180.0
    }
}

/// Where the e-puck's manual says that its proximity and light sensors look, degrees counter-clockwise from ahead.
const E_PUCK_ANGLES: [f32; 8] = [17.0, 50.0, 90.0, 150.0, 210.0, 270.0, 310.0, 343.0];

impl Robot {
    /// The e-puck with reference model RM1.1 or, with what Chocolate's modules get, RM1.2 (`../shared/data/argos`).
    pub(super) fn e_puck(outputs: Vec<Output>) -> Self {
        let rays = (0..8).map(|index| {
            // Opposites are so to the last bit.
            let angle = f64::from(index % 4) * 45.0 + 11.25;
            let (sin, cos) = angle.to_radians().sin_cos();
            let sign = if index < 4 { 1.0 } else { -1.0 };
            Ray {
                along: [cos as f32 * sign, sin as f32 * sign],
                reported: half_turns(E_PUCK_ANGLES[index as usize]),
            }
        });
        Self {
            radius: 0.035,
            height: 0.076,
            drive: Drive::Differential { wheel_base: 0.053 },
            top_speed: 0.12,
            wheel_noise: 0.05,
            acceleration: 3.75,
            friction: [0.49, 0.07],
            proximity: Some(Proximity {
                rays: rays.collect(),
                opposed: true,
                start: 0.036,
                range: 0.05,
                response: [1.08212, -36.8961, 298.701],
                noise: 0.05,
            }),
            light: Some(LightSensors {
                angles: E_PUCK_ANGLES.map(half_turns).to_vec(),
                reach: 2.5,
                noise: 0.05,
            }),
            ground: Some(GroundSensors {
                points: vec![[0.03, -0.009], [0.03, 0.0], [0.03, 0.009]],
                noise: 0.05,
            }),
            links: Some(Links {
                range: 0.7,
                loss: 0.85,
                offset: 7.0,
            }),
            around: None,
            message: 0,
            encoder_noise: 0.0,
            compass_noise: 0.0,
            outputs,
        }
    }

    /// The model with this name.
    pub(super) fn preset(name: &str) -> Option<Self> {
        use Output::*;
        match name {
            "e-puck-rm1.1" => Some(Self::e_puck(vec![
                Proximity,
                Light,
                GroundDrawn,
                NeighboursSquashed,
                AttractionParts,
            ])),
            "e-puck-rm1.2" => Some(Self::e_puck(vec![
                ProximityVector,
                LightDirection,
                Ground,
                Neighbours,
                Attraction,
                Random,
            ])),
            _ => {
                let (_, text) = MODELS.iter().find(|(known, _)| *known == name)?;
                let value = serde_saphyr::from_str::<Value>(text).ok()?;
                model::read(&value).ok()
            }
        }
    }

    /// A model as a name or an object; `place` is what it is called in complaints.
    ///
    /// # Errors
    /// What is wrong with it.
    pub(super) fn read(value: &Value, place: &str) -> Result<Self, ParameterError> {
        let expected = || {
            let models = MODELS.iter().map(|(name, _)| *name);
            let names: Vec<_> = Self::CODED.into_iter().chain(models).collect();
            format!("the name of a robot ({}) or an object", names.join(", "))
        };
        match value {
            Value::String(name) => Self::preset(name)
                .ok_or_else(|| wrong(place, format!("{name:?} found, expected {}", expected()))),
            Value::Object(_) => model::read(value).map_err(|error| with_place(place, error)),
            other => Err(wrong(
                place,
                format!("{other} found, expected {}", expected()),
            )),
        }
    }

    /// Models that are not files.
    const CODED: [&str; 2] = ["e-puck-rm1.1", "e-puck-rm1.2"];

    /// Names of the actuators.
    pub(super) fn actuator_names(&self) -> Vec<String> {
        let drive = self.drive.actuators().iter().map(|name| (*name).to_owned());
        drive.chain(numbered("message", self.message)).collect()
    }

    /// Numbers that controllers give.
    pub(super) fn actuators(&self) -> usize {
        self.drive.actuators().len() + self.message
    }

    /// How many numbers an output has.
    pub(super) fn width(&self, output: Output) -> usize {
        match output {
            Output::Proximity => self.proximity.as_ref().map_or(0, |p| p.rays.len()),
            Output::Light => self.light.as_ref().map_or(0, |l| l.angles.len()),
            Output::GroundReadings => self.ground.as_ref().map_or(0, |g| g.points.len()),
            Output::Message => self.message,
            Output::Encoders => self.drive.actuators().len(),
            Output::AroundCenter
            | Output::AroundHeading
            | Output::AroundNearest
            | Output::Compass => 2,
            Output::GroundDrawn => 3,
            Output::AttractionParts => 4,
            Output::ProximityVector | Output::LightDirection | Output::Attraction => 2,
            Output::Ground
            | Output::Neighbours
            | Output::NeighboursSquashed
            | Output::Random
            | Output::AroundCount => 1,
        }
    }

    /// The names of the numbers that controllers get.
    pub(super) fn sensor_names(&self) -> Vec<String> {
        let mut names = Vec::new();
        for output in &self.outputs {
            let parts: &[&str] = match output {
                Output::Proximity => {
                    names.extend(numbered("proximity", self.width(*output)));
                    continue;
                }
                Output::Light => {
                    names.extend(numbered("light", self.width(*output)));
                    continue;
                }
                Output::GroundReadings => {
                    names.extend(numbered("ground", self.width(*output)));
                    continue;
                }
                Output::Message => {
                    names.extend(numbered("message", self.width(*output)));
                    continue;
                }
                Output::Encoders => {
                    let drive = self.drive.actuators().iter();
                    names.extend(drive.map(|name| format!("{name} encoder")));
                    continue;
                }
                Output::AroundCount => &["robots around"],
                Output::AroundCenter => &["center x", "center y"],
                Output::AroundHeading => &["heading x", "heading y"],
                Output::AroundNearest => &["nearest x", "nearest y"],
                Output::Compass => &["compass x", "compass y"],
                Output::ProximityVector => &["proximity x", "proximity y"],
                Output::LightDirection => &["light x", "light y"],
                Output::GroundDrawn => &["ground left", "ground middle", "ground right"],
                Output::Ground => &["ground"],
                Output::Neighbours => &["neighbours"],
                Output::NeighboursSquashed => &["neighbours squashed"],
                Output::Attraction => &["attraction x", "attraction y"],
                Output::AttractionParts => &[
                    "attraction 45",
                    "attraction 135",
                    "attraction 225",
                    "attraction 315",
                ],
                Output::Random => &["random"],
            };
            names.extend(parts.iter().map(|name| (*name).to_owned()));
        }
        names
    }

    /// How far anything of another robot matters to the sensors, metres from middle to middle.
    pub(super) fn range(&self) -> f32 {
        let proximity = self.proximity.as_ref();
        let proximity = proximity.map_or(0.0, |p| p.start + p.range + self.radius);
        self.links
            .as_ref()
            .map_or(0.0, |links| links.range)
            .max(proximity)
            .max(self.around.unwrap_or(0.0))
    }

    /// Rims that are further apart than this at the beginning of a tick do not touch in it, metres.
    pub(super) fn reach(&self) -> f32 {
        (self.fastest() * TICK).max(0.03)
    }

    /// No two bodies approach each other faster, m/s.
    pub(super) fn fastest(&self) -> f32 {
        // The factor of the noise is at most 4.9 deviations off.
        (2.0 * self.top_speed * (1.0 + 4.9 * self.wheel_noise)).max(0.3)
    }

    /// Numbers that controllers get.
    pub(super) fn sensors(&self) -> usize {
        self.outputs.iter().map(|output| self.width(*output)).sum()
    }
}

/// A name for each of several sensors of a kind.
fn numbered(name: &str, count: usize) -> impl Iterator<Item = String> + '_ {
    (0..count).map(move |index| format!("{name} {index}"))
}
