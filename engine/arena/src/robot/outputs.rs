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
    /// What the camera gives, colour by colour.
    Camera,
    /// The charge of the battery, 0..=1.
    Battery,
}

impl Robot {
    /// How many numbers an output has.
    pub(in super::super) fn width(&self, output: Output) -> usize {
        match output {
            Output::Proximity => self.proximity.as_ref().map_or(0, |p| p.rays.len()),
            Output::Light => self.light.as_ref().map_or(0, |l| l.angles.len()),
            Output::GroundReadings => self.ground.as_ref().map_or(0, |g| g.points.len()),
            Output::Message => self.message,
            Output::Camera => self.camera.as_ref().map_or(0, |camera| {
                let each: usize = camera.gives.iter().map(|sight| sight.width()).sum();
                each * camera.colors.len()
            }),
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
            | Output::Battery
            | Output::AroundCount => 1,
        }
    }

    /// The names of the numbers that controllers get.
    pub(in super::super) fn sensor_names(&self) -> Vec<String> {
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
                Output::Camera => {
                    names.extend(self.camera.iter().flat_map(camera_names));
                    continue;
                }
                Output::Battery => &["battery"],
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

    /// Numbers that controllers get.
    pub(in super::super) fn sensors(&self) -> usize {
        self.outputs.iter().map(|output| self.width(*output)).sum()
    }

    /// Names of the actuators.
    pub(in super::super) fn actuator_names(&self) -> Vec<String> {
        let drive = self.drive.actuators().iter().map(|name| (*name).to_owned());
        let leds = self
            .leds
            .iter()
            .map(|color| format!("led {}", color.name()));
        drive
            .chain(leds)
            .chain(numbered("message", self.message))
            .collect()
    }

    /// Numbers that controllers give.
    pub(in super::super) fn actuators(&self) -> usize {
        self.drive.actuators().len() + self.leds.len() + self.message
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
