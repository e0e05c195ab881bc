//! Inputs and outputs of controllers, with their names.

use super::outputs::Output;
use super::parts::Camera;
use super::robot::Robot;

impl Robot {
    /// Returns the number of values of an output.
    #[inline(always)]
    pub fn width(&self, output: Output) -> usize {
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
            | Output::Flag
            | Output::NeighbourCount => 1,
        }
    }

    /// Returns the names of the controllers' inputs.
    pub fn sensor_names(&self) -> Vec<String> {
        let names = self.outputs.iter().map(|output| self.names(*output));
        names.flatten().collect()
    }

    /// Returns the names of an output's values; empty strings for an absent sensor.
    pub fn names(&self, output: Output) -> Vec<String> {
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
            Output::Flag => &["carries"],
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

    /// Returns the directions of an output's values in half turns, as reported to controllers; empty if they have none.
    pub fn directions(&self, output: Output) -> Vec<f32> {
        let rays = self.proximity.iter().flat_map(|sensors| &sensors.rays);
        let lights = self.light.iter().flat_map(|sensors| &sensors.angles);
        match output {
            Output::Proximity => rays.map(|ray| ray.reported).collect(),
            Output::Light => lights.copied().collect(),
            _ => Vec::new(),
        }
    }

    /// Returns the number of the controllers' inputs.
    pub fn sensors(&self) -> usize {
        self.outputs.iter().map(|output| self.width(*output)).sum()
    }

    /// Returns the names of the LED actuators.
    pub fn led_names(&self) -> Vec<String> {
        let names = self
            .leds
            .iter()
            .map(|color| format!("led {}", color.name()));
        names.collect()
    }

    /// Returns the names of the values of a sent message.
    pub fn message_names(&self) -> Vec<String> {
        numbered("message", self.message).collect()
    }
}

/// Returns a name for each value of a camera, colour by colour.
fn camera_names(camera: &Camera) -> impl Iterator<Item = String> + '_ {
    camera.colors.iter().flat_map(|color| {
        let names = camera.gives.iter().flat_map(|sight| sight.names());
        names.map(|name| format!("{} {name}", color.name()))
    })
}

/// Returns numbered names for several sensors of a kind.
fn numbered(name: &str, count: usize) -> impl Iterator<Item = String> + '_ {
    (0..count).map(move |index| format!("{name} {index}"))
}
