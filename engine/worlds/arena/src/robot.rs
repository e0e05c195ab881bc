//! Models of robots: body, drive, sensors, and what controllers get of them.

mod model;
mod outputs;
mod parts;
mod presets;

use serde_json::Value;

use super::mistakes::Mistakes;
use super::place::Place;
use super::settings::with_place;
pub(super) use outputs::Output;
pub(super) use parts::{
    Battery, Camera, Drive, GroundSensors, LedColor, LightSensors, Links, Proximity, Radio, Sight,
};
pub use presets::robots;
use swarmwright_simulation::ParameterError;
use swarmwright_simulation::parameters::wrong;

/// A model of a robot.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Robot {
    /// Metres.
    pub radius: f32,
    /// Metres; what lies lower does not hide it.
    pub height: f32,
    /// Kilograms: with the acceleration, how strongly it pushes objects.
    pub mass: f32,
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
    pub neighbour_range: Option<f32>,
    pub camera: Option<Camera>,
    /// The colours that the LEDs can show, an actuator each.
    pub leds: Vec<LedColor>,
    pub battery: Option<Battery>,
    /// Uniform noise of its reading.
    pub battery_noise: f32,
    /// How far from its rim it grips objects, metres.
    pub gripper: Option<f32>,
    /// Numbers of a message, actuators of their own.
    pub message: usize,
    /// Numbers that it hears of messages, as many as the longest one of the swarm has.
    pub heard: usize,
    /// Uniform noise of the encoders.
    pub encoder_noise: f32,
    /// Uniform noise of the compass, half turns.
    pub compass_noise: f32,
    pub outputs: Vec<Output>,
}

/// Seconds.
pub(super) const TICK: f32 = 0.1;

impl Robot {
    /// A robot without sensors and noise, with the friction and the acceleration of an e-puck.
    fn bare(radius: f32, height: f32, drive: Drive, top_speed: f32) -> Self {
        Self {
            radius,
            height,
            mass: presets::MASS,
            drive,
            top_speed,
            wheel_noise: 0.0,
            acceleration: presets::ACCELERATION,
            friction: presets::FRICTION,
            proximity: None,
            light: None,
            ground: None,
            links: None,
            neighbour_range: None,
            camera: None,
            leds: Vec::new(),
            battery: None,
            battery_noise: 0.0,
            gripper: None,
            message: 0,
            heard: 0,
            encoder_noise: 0.0,
            compass_noise: 0.0,
            outputs: Vec::new(),
        }
    }

    /// A model as a name or an object; `place` is what it is called in complaints, `others_send` whether other kinds of robots
    /// send messages that it hears.
    ///
    /// # Errors
    /// All that is wrong with it.
    pub(super) fn read(value: &Value, place: &str, others_send: bool) -> Result<Self, Mistakes> {
        let expected = || format!("the name of a robot ({}) or an object", presets::names());
        match value {
            Value::String(name) => Self::preset(name).ok_or_else(|| {
                let hint = presets::suggestion(name);
                wrong(
                    place,
                    format!("{name:?} found, expected {}{hint}", expected()),
                )
                .into()
            }),
            Value::Object(_) => {
                let read = model::read(value, others_send);
                read.map_err(|mistakes| mistakes.map(|mistake| with_place(place, mistake)))
            }
            other => Err(wrong(place, format!("{other} found, expected {}", expected())).into()),
        }
    }

    /// Finds what it names in a mission; `at` is what the robot is called in complaints.
    ///
    /// # Errors
    /// The mission lacks the patch on which batteries charge.
    pub(super) fn settle(&mut self, place: &Place, at: &str) -> Result<(), ParameterError> {
        let battery = self.battery.as_mut();
        let Some(charging) = battery.and_then(|battery| battery.charging.as_mut()) else {
            return Ok(());
        };
        let name = &charging.name;
        charging.patch = place.index(name).ok_or_else(|| {
            let names: Vec<_> = place.patches.iter().map(|patch| &patch.name[..]).collect();
            let there_is = match names.as_slice() {
                [] => "there is none".to_owned(),
                names => format!("there is {}", names.join(", ")),
            };
            wrong(
                &format!("{at}.battery.charging.patch"),
                format!("no patch of the mission's floor is named {name:?}; {there_is}"),
            )
        })?;
        Ok(())
    }

    /// How far anything of another robot matters to the sensors, metres from middle to middle.
    /// `largest`: the radius of the largest robot.
    pub(super) fn range(&self, largest: f32) -> f32 {
        let proximity = self.proximity.as_ref();
        let proximity = proximity.map_or(0.0, |p| p.start + p.range + largest);
        self.links
            .as_ref()
            .map_or(0.0, Links::reach)
            .max(proximity)
            .max(self.neighbour_range.unwrap_or(0.0))
            .max(self.camera.as_ref().map_or(0.0, |camera| camera.range))
            .max(self.light.as_ref().map_or(0.0, |light| light.shadow))
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
}
