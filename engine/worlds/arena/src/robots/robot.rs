//! Models of robots: body, drive, sensors, and what controllers get of them.

use swarmwright_simulation::ParameterError;
use swarmwright_simulation::parameters::wrong;

use super::outputs::Output;
use super::parts::{Battery, Camera, Drive, GroundSensors, LightSensors, Links, Proximity};
use crate::place::{LedColor, Place};
use crate::time::TICK;

/// Of an e-puck, kilograms, as in ARGoS; of other robots that do not say theirs.
pub(super) const MASS: f32 = 0.4;
/// Largest change of velocity by the drive, m/s^2, in the same way.
pub(super) const ACCELERATION: f32 = 3.75;
/// Coefficients of friction with robots and objects, and with walls, in the same way.
pub(super) const FRICTION: [f32; 2] = [0.49, 0.07];

/// A model of a robot.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Robot {
    /// Metres.
    pub radius: f32,
    /// Metres; what lies lower does not hide it.
    pub height: f32,
    /// Mass in kilograms; with the acceleration, it determines how strongly the robot pushes objects.
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

impl Robot {
    /// A robot without sensors and noise, with the friction and the acceleration of an e-puck.
    pub(super) fn bare(radius: f32, height: f32, drive: Drive, top_speed: f32) -> Self {
        Self {
            radius,
            height,
            mass: MASS,
            drive,
            top_speed,
            wheel_noise: 0.0,
            acceleration: ACCELERATION,
            friction: FRICTION,
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

    /// Resolves the parts of a mission that it names; `at` is the robot's path in error messages.
    ///
    /// # Errors
    /// The mission lacks the patch on which batteries charge.
    pub(crate) fn settle(&mut self, layout: &Place, at: &str) -> Result<(), ParameterError> {
        let battery = self.battery.as_mut();
        let Some(charging) = battery.and_then(|battery| battery.charging.as_mut()) else {
            return Ok(());
        };
        let name = &charging.name;
        charging.patch = layout.index(name).ok_or_else(|| {
            let names: Vec<_> = layout.patches.iter().map(|patch| &patch.name[..]).collect();
            let available = match names.as_slice() {
                [] => "none".to_owned(),
                names => names.join(", "),
            };
            wrong(
                &format!("{at}.battery.charging.patch"),
                format!(
                    "no patch of the mission's floor is named {name:?}; available: {available}"
                ),
            )
        })?;
        Ok(())
    }

    /// How far anything of another robot matters to the sensors, metres from middle to middle.
    /// `largest`: the radius of the largest robot.
    pub(crate) fn range(&self, largest: f32) -> f32 {
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
    pub(crate) fn reach(&self) -> f32 {
        (self.fastest() * TICK).max(0.03)
    }

    /// Upper limit of the speed at which two bodies approach each other, m/s.
    pub(crate) fn fastest(&self) -> f32 {
        // The factor of the noise is at most 4.9 deviations off.
        (2.0 * self.top_speed * (1.0 + 4.9 * self.wheel_noise)).max(0.3)
    }
}

/// Robots of the same model.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Group {
    /// Name in pictures and metrics.
    pub name: String,
    pub robot: Robot,
    pub count: usize,
}
