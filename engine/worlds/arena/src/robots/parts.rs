//! Parts of robots: the drive, the sensors, LEDs and the battery.

use serde::Deserialize;

use crate::place::LedColor;

/// Converts degrees to half turns.
pub(super) const fn half_turns(degrees: f32) -> f32 {
    if degrees > 180.0 {
        (degrees - 360.0) / 180.0
    } else {
        degrees / 180.0
    }
}

/// A ray in the frame of the robot, with x ahead and y to the left.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Ray {
    /// Unit vector.
    pub along: [f32; 2],
    /// Angle reported to controllers, half turns counter-clockwise from ahead.
    pub reported: f32,
}

/// Proximity sensors: rays that detect bodies and walls.
#[derive(Debug, Clone, PartialEq)]
pub struct Proximity {
    pub rays: Vec<Ray>,
    /// Whether each ray of the first half has its opposite in the second half, so that at most one of the two hits a
    /// given body.
    pub opposed: bool,
    /// Distance from the middle at which rays begin, metres.
    pub start: f32,
    /// Whether a ray that begins inside a body does not detect it, as in ARGoS.
    pub blind_inside: bool,
    /// Length of the rays, metres.
    pub range: f32,
    /// Coefficients c0, c1, c2: a reading is c0 + c1 d + c2 d^2 for a distance of d, limited to 0..=1.
    pub response: [f32; 3],
    /// Half-width of the uniform noise, after which the reading is limited again.
    pub noise: f32,
}

impl Proximity {
    /// Returns the number of opposite pairs if the rays are opposed, else the number of rays.
    #[inline(always)]
    pub fn halves(&self) -> usize {
        if self.opposed {
            self.rays.len() / 2
        } else {
            self.rays.len()
        }
    }

    /// Returns the minimum distance along a ray at which it detects a body. It is negative, down to the middle of the
    /// robot, unless the sensor is blind inside bodies.
    #[inline(always)]
    pub fn least(&self) -> f32 {
        if self.blind_inside { 0.0 } else { -self.start }
    }

    /// Returns the ray opposite to a ray of the first half.
    #[inline(always)]
    pub fn opposite(&self, ray: usize) -> Option<usize> {
        self.opposed.then_some(ray + self.rays.len() / 2)
    }
}

/// Light sensors.
#[derive(Debug, Clone, PartialEq)]
pub struct LightSensors {
    /// Directions, half turns counter-clockwise from ahead.
    pub angles: Vec<f32>,
    /// Distance divided by intensity up to which light is detected.
    pub reach: f32,
    /// Maximum distance, metres from middle to middle, at which another robot can hide a lamp of the mission.
    pub shadow: f32,
    /// Half-width of the uniform noise.
    pub noise: f32,
}

/// Sensors that look at the floor.
#[derive(Debug, Clone, PartialEq)]
pub struct GroundSensors {
    /// Positions in the frame of the robot, metres.
    pub points: Vec<[f32; 2]>,
    /// Half-width of the uniform noise.
    pub noise: f32,
}

/// Range-and-bearing sensor, which receives messages of neighbours.
#[derive(Debug, Clone, PartialEq)]
pub struct Links {
    /// Maximum distance between middles, metres.
    pub range: f32,
    /// Probability that a message is lost, drawn for each link and tick.
    pub loss: f32,
    /// Further imperfections; `None` for range and loss only.
    pub radio: Option<Radio>,
}

impl Links {
    /// Returns the maximum distance at which messages are received, metres.
    pub fn reach(&self) -> f32 {
        let radio = self.radio.as_ref();
        radio.map_or(self.range, |radio| self.range * radio.stretch)
    }

    /// Returns the delay of messages, in ticks.
    #[inline]
    pub fn delay(&self) -> u32 {
        self.radio.as_ref().map_or(0, |radio| radio.delay)
    }

    /// Returns whether robots, walls and objects block messages.
    #[inline(always)]
    pub fn line_of_sight(&self) -> bool {
        self.radio.as_ref().is_none_or(|radio| radio.line_of_sight)
    }
}

/// Properties of the radio channel between robots.
#[derive(Debug, Clone, PartialEq)]
pub struct Radio {
    /// Shape parameter of Nakagami fading; 0 without fading, so that all messages within the range are received.
    pub fading: u32,
    /// Path-loss exponent.
    pub exponent: f32,
    /// Logarithm of the probability that a message does not collide with another one; 0 without collisions.
    pub crowding: f32,
    /// Ticks between two messages of a robot.
    pub interval: u32,
    /// Ticks between sending and reception.
    pub delay: u32,
    /// Whether robots, walls and objects block messages.
    pub line_of_sight: bool,
    /// Distance beyond which no message is received, in units of the range.
    pub stretch: f32,
}

/// The kinematics of a robot.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Drive {
    /// Two wheels, left and right; `wheel_base` is the distance between them, metres.
    Differential { wheel_base: f32 },
    /// Motion in any direction, with a turn rate of up to `turn`, rad/s.
    Holonomic { turn: f32 },
    /// A speed and the angle of the front wheels; `wheel_base` is the distance between the axles, metres, `steering`
    /// the maximum angle to either side, half turns.
    Car { wheel_base: f32, steering: f32 },
}

impl Drive {
    pub fn actuators(self) -> &'static [&'static str] {
        match self {
            Self::Differential { .. } => &["left wheel", "right wheel"],
            Self::Holonomic { .. } => &["ahead", "left", "turn"],
            Self::Car { .. } => &["speed", "steering"],
        }
    }

    /// Returns whether the drive can move sideways.
    pub const fn is_holonomic(self) -> bool {
        matches!(self, Self::Holonomic { .. })
    }

    /// Returns the maximum turn rate, rad/s, at a speed of the wheels or of the robot.
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

/// A quantity that a camera measures for each colour.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Sight {
    /// The number of things of the colour.
    Count,
    /// 1 if anything of the colour is in sight, else 0.
    Seen,
    /// The sum of 1 / (1 + range in cm) along the bearings of these things: x, y.
    Attraction,
    /// The direction of the attraction as a unit vector: x, y.
    Direction,
    /// The components of the attraction along 45, 135, 225 and 315 degrees, as in range and bearing.
    Sectors,
}

impl Sight {
    pub const fn width(self) -> usize {
        match self {
            Self::Count | Self::Seen => 1,
            Self::Attraction | Self::Direction => 2,
            Self::Sectors => 4,
        }
    }

    /// Returns the names of the values, without the name of the colour.
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
pub struct Camera {
    /// Maximum distance, metres from middle to middle.
    pub range: f32,
    /// Half-width of the uniform noise of each direction, half turns.
    pub noise: f32,
    pub colors: Vec<LedColor>,
    pub gives: Vec<Sight>,
}

/// A battery; a charge of 1 is full.
#[derive(Debug, Clone, PartialEq)]
pub struct Battery {
    /// Seconds that a full battery lasts while the robot stands, and while its drive is at the maximum.
    pub standing: f32,
    pub driving: f32,
    /// Charge at the start, 0..=1.
    pub charge: f32,
    pub charging: Option<Charging>,
}

/// A charging station.
#[derive(Debug, Clone, PartialEq)]
pub struct Charging {
    /// Name of a patch of the floor.
    pub name: String,
    /// Index of the patch, set once the mission is known.
    pub patch: usize,
    /// Seconds from empty to full.
    pub duration: f32,
}
