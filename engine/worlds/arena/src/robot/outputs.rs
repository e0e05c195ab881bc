//! The numbers that controllers get and give.

use super::{Camera, Robot};

/// Numbers that controllers get, in the order of a model's list.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(in super::super) enum Output {
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
    /// What the drive aimed at in the tick before, with its noise: for each actuator of the drive a share of the largest
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
pub(in super::super) enum Neutral {
    Zero,
    /// On a floor that is neither black nor white.
    Half,
    /// A full battery.
    One,
}

impl Neutral {
    pub(in super::super) const fn number(self) -> f32 {
        match self {
            Self::Zero => 0.0,
            Self::Half => 0.5,
            Self::One => 1.0,
        }
    }
}

impl Output {
    /// What a robot without the sensor gets.
    pub(in super::super) const fn neutral(self) -> Neutral {
        match self {
            Self::Ground | Self::GroundDrawn | Self::GroundReadings => Neutral::Half,
            Self::Battery => Neutral::One,
            _ => Neutral::Zero,
        }
    }
}

impl Robot {
    /// How many numbers an output has.
    #[inline(always)]
    pub(in super::super) fn width(&self, output: Output) -> usize {
        match output {
            Output::Proximity => self.proximity.as_ref().map_or(0, |p| p.rays.len()),
            Output::Light => self.light.as_ref().map_or(0, |l| l.angles.len()),
            Output::GroundReadings => self.ground.as_ref().map_or(0, |g| g.points.len()),
            Output::Message => self.heard,
            Output::Camera => self.camera.as_ref().map_or(0, |camera| {
                let each: usize = camera.gives.iter().map(|sight| sight.width()).sum();
                each * camera.colors.len()
            }),
            Output::Encoders => self.drive.actuators().len(),
            Output::NeighbourCenter
            | Output::NeighbourHeading
            | Output::NeighbourNearest
            | Output::Compass => 2,
            Output::GroundDrawn => 3,
            Output::AttractionParts => 4,
            Output::Absent(numbers, _) => numbers.into(),
            Output::ProximityVector | Output::LightDirection | Output::Attraction => 2,
            Output::Ground
            | Output::MessageCount
            | Output::MessageCountSquashed
            | Output::Random
            | Output::Battery
            | Output::Gripper
            | Output::NeighbourCount => 1,
        }
    }

    /// The names of the numbers that controllers get.
    pub(in super::super) fn sensor_names(&self) -> Vec<String> {
        let names = self.outputs.iter().map(|output| self.names(*output));
        names.flatten().collect()
    }

    /// The names of the numbers of an output; empty ones of what it has not.
    pub(in super::super) fn names(&self, output: Output) -> Vec<String> {
        let width = self.width(output);
        let parts: &[&str] = match output {
            Output::Proximity => return numbered("proximity", width).collect(),
            Output::Light => return numbered("light", width).collect(),
            Output::GroundReadings => return numbered("ground", width).collect(),
            Output::Message => return numbered("message", width).collect(),
            Output::Encoders => {
                let drive = self.drive.actuators().iter();
                return drive.map(|name| format!("{name} encoder")).collect();
            }
            Output::Camera => return self.camera.iter().flat_map(camera_names).collect(),
            Output::Absent(..) => return vec![String::new(); width],
            Output::Battery => &["battery"],
            Output::Gripper => &["holds"],
            Output::NeighbourCount => &["neighbours"],
            Output::NeighbourCenter => &["center x", "center y"],
            Output::NeighbourHeading => &["heading x", "heading y"],
            Output::NeighbourNearest => &["nearest x", "nearest y"],
            Output::Compass => &["compass x", "compass y"],
            Output::ProximityVector => &["proximity x", "proximity y"],
            Output::LightDirection => &["light x", "light y"],
            Output::GroundDrawn => &["ground left", "ground middle", "ground right"],
            Output::Ground => &["ground"],
            Output::MessageCount => &["messages heard"],
            Output::MessageCountSquashed => &["messages heard squashed"],
            Output::Attraction => &["attraction x", "attraction y"],
            Output::AttractionParts => &[
                "attraction 45",
                "attraction 135",
                "attraction 225",
                "attraction 315",
            ],
            Output::Random => &["random"],
        };
        parts.iter().map(|name| (*name).to_owned()).collect()
    }

    /// Where the numbers of an output look, as controllers are told, half turns; empty where they look nowhere.
    pub(in super::super) fn directions(&self, output: Output) -> Vec<f32> {
        let rays = self.proximity.iter().flat_map(|sensors| &sensors.rays);
        let lights = self.light.iter().flat_map(|sensors| &sensors.angles);
        match output {
            Output::Proximity => rays.map(|ray| ray.reported).collect(),
            Output::Light => lights.copied().collect(),
            _ => Vec::new(),
        }
    }

    /// Numbers that controllers get.
    pub(in super::super) fn sensors(&self) -> usize {
        self.outputs.iter().map(|output| self.width(*output)).sum()
    }

    /// Names of the numbers for LEDs.
    pub(in super::super) fn led_names(&self) -> Vec<String> {
        let names = self
            .leds
            .iter()
            .map(|color| format!("led {}", color.name()));
        names.collect()
    }

    /// Names of the numbers of a message that is sent.
    pub(in super::super) fn message_names(&self) -> Vec<String> {
        numbered("message", self.message).collect()
    }
}

/// Colour by colour a name for each number.
fn camera_names(camera: &Camera) -> impl Iterator<Item = String> + '_ {
    camera.colors.iter().flat_map(|color| {
        let names = camera.gives.iter().flat_map(|sight| sight.names());
        names.map(|name| format!("{} {name}", color.name()))
    })
}

/// A name for each of several sensors of a kind.
fn numbered(name: &str, count: usize) -> impl Iterator<Item = String> + '_ {
    (0..count).map(move |index| format!("{name} {index}"))
}
