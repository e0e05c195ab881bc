//! Outputs of sensors, which controllers receive.

/// An output of a sensor. Controllers receive the outputs in the order of the model's list.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Output {
    /// The reading of each proximity sensor, 0..=1.
    Proximity,
    /// The sum of the proximity readings as vectors along their rays, limited to length 1: x, y.
    ProximityVector,
    /// The reading of each light sensor, 0..=1.
    Light,
    /// The direction of light as a unit vector: x, y; or 0, 0 if no reading is above 0.2.
    LightDirection,
    /// Three values: 0 on black, 1 on white, and on grey random draws with means of about 0.407, 0.344 and 0.424.
    GroundDrawn,
    /// 0 on black, 0.5 on grey, 1 on white.
    Ground,
    /// The number of messages received in this tick, at most one from each robot.
    MessageCount,
    /// 1 - 2 / (1 + e^n) for the n messages received in this tick.
    MessageCountSquashed,
    /// The sum of 1 / (1 + range in cm) along the bearings of the messages of the last 11 ticks: x, y.
    Attraction,
    /// The components of the attraction along 45, 135, 225 and 315 degrees, after its length is squashed to tanh(length
    /// / 2); negative components are 0.
    AttractionParts,
    /// A random number in 0..1, drawn anew in each tick.
    Random,
    /// The reading of each ground sensor, from 0 (black) to 1 (white).
    GroundReadings,
    /// The mean of the messages received in this tick, value by value, over the messages that have that value; 0
    /// without messages.
    Message,
    /// The number of robots within `neighbour_range`.
    NeighbourCount,
    /// The mean position of these robots in the robot's frame, in units of the range: x, y; 0, 0 without neighbours.
    NeighbourCenter,
    /// The mean of these robots' headings in the robot's frame, as unit vectors: x, y.
    NeighbourHeading,
    /// The position of the nearest of these robots in the robot's frame, in units of the range: x, y.
    NeighbourNearest,
    /// The target of the drive in the previous tick, with its noise: for each actuator of the drive, a fraction of the
    /// maximum speed.
    Encoders,
    /// The direction of the x axis in the robot's frame as a unit vector: x, y.
    Compass,
    /// The values of the camera, colour by colour.
    Camera,
    /// The charge of the battery, 0..=1.
    Battery,
    /// 1 if the gripper holds an object, else 0.
    Gripper,
    /// 1 if the robot carries a flag, else 0.
    Flag,
    /// Neutral values for a sensor that only other kinds of robots have, and how many.
    Absent(u8, Neutral),
}

/// The value of a sensor when there is nothing to sense.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Neutral {
    Zero,
    /// For sensors of the floor: neither black nor white.
    Half,
    /// For the battery: full.
    One,
}

impl Neutral {
    pub const fn number(self) -> f32 {
        match self {
            Self::Zero => 0.0,
            Self::Half => 0.5,
            Self::One => 1.0,
        }
    }
}

impl Output {
    /// Returns the value for robots without the sensor.
    pub const fn neutral(self) -> Neutral {
        match self {
            Self::Ground | Self::GroundDrawn | Self::GroundReadings => Neutral::Half,
            Self::Battery => Neutral::One,
            _ => Neutral::Zero,
        }
    }
}
