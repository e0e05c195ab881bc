//! Parts of robots: the drive and the sensors.

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
pub(in super::super) struct Ray {
    /// Unit vector.
    pub along: [f32; 2],
    /// The angle that controllers are told, half turns counter-clockwise from ahead.
    pub reported: f32,
}

/// Proximity sensors: rays that see bodies and walls.
#[derive(Debug, Clone, PartialEq)]
pub(in super::super) struct Proximity {
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
    pub(in super::super) fn halves(&self) -> usize {
        if self.opposed {
            self.rays.len() / 2
        } else {
            self.rays.len()
        }
    }

    /// The ray opposite to one of the first half.
    #[inline(always)]
    pub(in super::super) fn opposite(&self, ray: usize) -> Option<usize> {
        self.opposed.then_some(ray + self.rays.len() / 2)
    }
}

/// Light sensors.
#[derive(Debug, Clone, PartialEq)]
pub(in super::super) struct LightSensors {
    /// Half turns counter-clockwise from ahead.
    pub angles: Vec<f32>,
    /// Distance divided by intensity up to which light is seen.
    pub reach: f32,
    /// Uniform noise.
    pub noise: f32,
}

/// Sensors that look at the floor.
#[derive(Debug, Clone, PartialEq)]
pub(in super::super) struct GroundSensors {
    /// Places in the frame of the robot, metres.
    pub points: Vec<[f32; 2]>,
    /// Uniform noise.
    pub noise: f32,
}

/// Range and bearing of neighbours.
#[derive(Debug, Clone, PartialEq)]
pub(in super::super) struct Links {
    /// Largest distance of middles, metres.
    pub range: f32,
    /// Probability that a message is lost, drawn for each link and tick.
    pub loss: f32,
    /// What is subtracted from the distance, centimetres.
    pub offset: f32,
}

/// How a robot moves.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(in super::super) enum Drive {
    /// Two wheels, left and right, this far apart, metres.
    Differential { wheel_base: f32 },
    /// In any direction, ahead and to the left, while it turns by up to this, rad/s.
    Holonomic { turn: f32 },
    /// A speed and the angle of the front wheels, up to this many half turns to either side; axles this far apart, metres.
    Car { wheel_base: f32, steering: f32 },
}

impl Drive {
    pub(super) fn actuators(self) -> &'static [&'static str] {
        match self {
            Self::Differential { .. } => &["left wheel", "right wheel"],
            Self::Holonomic { .. } => &["ahead", "left", "turn"],
            Self::Car { .. } => &["speed", "steering"],
        }
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
