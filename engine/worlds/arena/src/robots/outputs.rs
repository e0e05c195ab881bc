//! The outputs that controllers receive.

/// Numbers that controllers get, in the order of a model's list.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Output {
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
    /// Number of messages heard in this tick, one of each robot.
    MessageCount,
    /// 1 - 2 / (1 + e^n) of the messages n heard in this tick.
    MessageCountSquashed,
    /// Sum of 1 / (1 + range in cm) along the bearings of the messages of the last 11 ticks: x, y.
    Attraction,
    /// The same, squashed to the length tanh(length / 2), along 45, 135, 225 and 315 degrees; 0 where that is negative.
    AttractionParts,
    /// A number in 0..1, drawn anew in each tick.
    Random,
    /// The reading of each ground sensor, 0 black to 1 white.
    GroundReadings,
    /// The mean of the messages heard in this tick, number by number, of those that have it; 0 where none is heard.
    Message,
    /// Number of robots within `neighbour_range`.
    NeighbourCount,
    /// Mean of the positions of those robots in the robot's frame, in ranges: x, y; 0, 0 where there is none.
    NeighbourCenter,
    /// Mean of their headings in the robot's frame as unit vectors: x, y.
    NeighbourHeading,
    /// The nearest of them in the robot's frame, in ranges: x, y.
    NeighbourNearest,
    /// Target of the drive in the previous tick, with its noise: for each actuator of the drive a share of the largest
    /// speed.
    Encoders,
    /// The direction of the x axis in the robot's frame as a unit vector: x, y.
    Compass,
    /// What the camera gives, colour by colour.
    Camera,
    /// The charge of the battery, 0..=1.
    Battery,
    /// 1 where the gripper holds something, else 0.
    Gripper,
    /// So many numbers of a sensor that other kinds of robots have: what it gives where there is nothing.
    Absent(u8, Neutral),
}

/// What a sensor gives where there is nothing.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Neutral {
    Zero,
    /// On a floor that is neither black nor white.
    Half,
    /// A full battery.
    One,
}

impl Neutral {
    pub(crate) const fn number(self) -> f32 {
        match self {
            Self::Zero => 0.0,
            Self::Half => 0.5,
            Self::One => 1.0,
        }
    }
}

impl Output {
    /// What a robot without the sensor gets.
    pub(crate) const fn neutral(self) -> Neutral {
        match self {
            Self::Ground | Self::GroundDrawn | Self::GroundReadings => Neutral::Half,
            Self::Battery => Neutral::One,
            _ => Neutral::Zero,
        }
    }
}
