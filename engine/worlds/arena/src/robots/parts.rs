//! Parts of robots: the drive, the sensors, LEDs and the battery.

use serde::Deserialize;

use crate::place::LedColor;

/// Degrees in half turns.
pub(super) const fn half_turns(degrees: f32) -> f32 {
    if degrees > 180.0 {
        (degrees - 360.0) / 180.0
    } else {
        degrees / 180.0
    }
}

/// A ray in the frame of the robot, x ahead, y to the left.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Ray {
    /// Unit vector.
    pub along: [f32; 2],
    /// The angle that controllers are told, half turns counter-clockwise from ahead.
    pub reported: f32,
}

/// Proximity sensors: rays that see bodies and walls.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Proximity {
    pub rays: Vec<Ray>,
    /// Whether each ray of the first half has its opposite in the second one: what one of them meets the other does not.
    pub opposed: bool,
    /// Where rays begin, metres from the middle.
    pub start: f32,
    /// Whether a ray that begins inside of a body does not see it, as in ARGoS.
    pub blind_inside: bool,
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
    pub(crate) fn halves(&self) -> usize {
        if self.opposed {
            self.rays.len() / 2
        } else {
            self.rays.len()
        }
    }

    /// The least distance from where a ray begins at which it sees a body: down to the middle of the robot unless it is blind.
    #[inline(always)]
    pub(crate) fn least(&self) -> f32 {
        if self.blind_inside { 0.0 } else { -self.start }
    }

    /// The ray opposite to one of the first half.
    #[inline(always)]
    pub(crate) fn opposite(&self, ray: usize) -> Option<usize> {
        self.opposed.then_some(ray + self.rays.len() / 2)
    }
}

/// Light sensors.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct LightSensors {
    /// Half turns counter-clockwise from ahead.
    pub angles: Vec<f32>,
    /// Distance divided by intensity up to which light is seen.
    pub reach: f32,
    /// How far from a robot another one may stand that hides a lamp of the mission from it, metres from middle to middle.
    pub shadow: f32,
    /// Uniform noise.
    pub noise: f32,
}

/// Sensors that look at the floor.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct GroundSensors {
    /// Places in the frame of the robot, metres.
    pub points: Vec<[f32; 2]>,
    /// Uniform noise.
    pub noise: f32,
}

/// Range and bearing of neighbours.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Links {
    /// Largest distance of middles, metres.
    pub range: f32,
    /// Probability that a message is lost, drawn for each link and tick.
    pub loss: f32,
    /// Further imperfections; `None` if only the range and the loss count.
    pub radio: Option<Radio>,
}

impl Links {
    /// How far messages are ever heard, metres.
    pub(crate) fn reach(&self) -> f32 {
        let radio = self.radio.as_ref();
        radio.map_or(self.range, |radio| self.range * radio.stretch)
    }

    /// How many ticks ago the numbers that arrive were sent.
    pub(crate) fn delay(&self) -> u32 {
        self.radio.as_ref().map_or(0, |radio| radio.delay)
    }

    /// Whether robots, walls and objects stop messages.
    #[inline(always)]
    pub(crate) fn line_of_sight(&self) -> bool {
        self.radio.as_ref().is_none_or(|radio| radio.line_of_sight)
    }
}

/// How messages fare between the robots of a swarm.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Radio {
    /// The shape of Nakagami fading; 0 for none, so that all within the range is heard.
    pub fading: u32,
    /// Of the path loss.
    pub exponent: f32,
    /// The logarithm of the probability that a message does not collide with another one; 0 where none collide.
    pub crowding: f32,
    /// Ticks from a robot's message to its next one.
    pub interval: u32,
    /// Ticks from the sending of numbers to their reception.
    pub delay: u32,
    /// Whether robots, walls and objects stop messages.
    pub line_of_sight: bool,
    /// The distance beyond which nothing is ever heard, in ranges.
    pub stretch: f32,
}

/// How a robot moves.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) enum Drive {
    /// Two wheels, left and right, this far apart, metres.
    Differential { wheel_base: f32 },
    /// In any direction, ahead and to the left, while it turns by up to this, rad/s.
    Holonomic { turn: f32 },
    /// A speed and the angle of the front wheels, up to this many half turns to either side; axles this far apart, metres.
    Car { wheel_base: f32, steering: f32 },
}

impl Drive {
    pub(crate) fn actuators(self) -> &'static [&'static str] {
        match self {
            Self::Differential { .. } => &["left wheel", "right wheel"],
            Self::Holonomic { .. } => &["ahead", "left", "turn"],
            Self::Car { .. } => &["speed", "steering"],
        }
    }

    /// Whether it moves sideways.
    pub(crate) const fn is_holonomic(self) -> bool {
        matches!(self, Self::Holonomic { .. })
    }

    /// rad/s, at a speed of the wheels or of the robot.
    pub(super) fn fastest_turn(self, speed: f32) -> f32 {
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

/// What a camera gives of each colour.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "snake_case")]
pub(crate) enum Sight {
    /// How many robots and lamps have it.
    Count,
    /// 1 where one has it, else 0.
    Seen,
    /// The sum of 1 / (1 + range in cm) along their bearings: x, y.
    Attraction,
    /// The direction of that, of length 1: x, y.
    Direction,
    /// The same as of range and bearing along 45, 135, 225 and 315 degrees.
    Sectors,
}

impl Sight {
    pub(crate) const fn width(self) -> usize {
        match self {
            Self::Count | Self::Seen => 1,
            Self::Attraction | Self::Direction => 2,
            Self::Sectors => 4,
        }
    }

    /// What the numbers are called after the name of the colour.
    pub(super) const fn names(self) -> &'static [&'static str] {
        match self {
            Self::Count => &["count"],
            Self::Seen => &["seen"],
            Self::Attraction => &["attraction x", "attraction y"],
            Self::Direction => &["direction x", "direction y"],
            Self::Sectors => &["45", "135", "225", "315"],
        }
    }
}

/// An omnidirectional camera.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Camera {
    /// Metres from middle to middle.
    pub range: f32,
    /// Uniform noise of the direction of each thing seen, half turns.
    pub noise: f32,
    pub colors: Vec<LedColor>,
    pub gives: Vec<Sight>,
}

/// A battery, full at 1.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Battery {
    /// Seconds that a full one lasts while the robot stands, and while its drive is told the most.
    pub standing: f32,
    pub driving: f32,
    /// At the start.
    pub charge: f32,
    pub charging: Option<Charging>,
}

/// Where batteries charge.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Charging {
    /// The name of a patch of the floor.
    pub name: String,
    /// Its index, once the mission is known.
    pub patch: usize,
    /// Seconds from empty to full.
    pub duration: f32,
}
