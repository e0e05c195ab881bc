//! Models of robots: body, drive, sensors, and the inputs of controllers.

use serde_json::Value;
use swarmwright_simulation::ParameterError;
use swarmwright_simulation::parameters::wrong;

use super::outputs::Output;
use super::parts::{Battery, Camera, Drive, GroundSensors, LightSensors, Links, Proximity};
use crate::place::{LedColor, Place};
use crate::time::TICK;

/// Default mass, kg: that of an e-puck in ARGoS.
pub(super) const MASS: f32 = 0.4;
/// Default maximum acceleration of the drive, m/s^2, as for an e-puck in ARGoS.
pub(super) const ACCELERATION: f32 = 3.75;
/// Default coefficients of friction with robots and objects, and with walls, as for an e-puck in ARGoS.
pub(super) const FRICTION: [f32; 2] = [0.49, 0.07];

/// A model of a robot.
#[derive(Debug, Clone, PartialEq)]
pub struct Robot {
    /// Radius, metres.
    pub radius: f32,
    /// Height, metres; lower bodies do not hide the robot.
    pub height: f32,
    /// Mass in kilograms; with the acceleration, it determines how strongly the robot pushes objects.
    pub mass: f32,
    pub drive: Drive,
    /// Maximum speed of a wheel or of the robot, m/s, for actuators of 1.
    pub top_speed: f32,
    /// Standard deviation of the relative error of a wheel's speed in a tick.
    pub wheel_noise: f32,
    /// Maximum acceleration of the drive, m/s^2.
    pub acceleration: f32,
    /// Coefficients of friction with robots and with walls.
    pub friction: [f32; 2],
    pub proximity: Option<Proximity>,
    pub light: Option<LightSensors>,
    pub ground: Option<GroundSensors>,
    pub links: Option<Links>,
    /// Distance up to which the robot detects others without loss or occlusion, metres.
    pub neighbour_range: Option<f32>,
    pub camera: Option<Camera>,
    /// Colour of the body, which cameras see.
    pub color: Option<LedColor>,
    /// Colours that the LEDs can show, with an actuator each.
    pub leds: Vec<LedColor>,
    pub battery: Option<Battery>,
    /// Half-width of the uniform noise of the battery's reading.
    pub battery_noise: f32,
    /// Reach of the gripper from the rim, metres.
    pub gripper: Option<f32>,
    /// Number of values in a message, each with its own actuator.
    pub message: usize,
    /// Number of values received of messages: that of the longest message in the swarm.
    pub heard: usize,
    /// Half-width of the uniform noise of the encoders.
    pub encoder_noise: f32,
    /// Half-width of the uniform noise of the compass, half turns.
    pub compass_noise: f32,
    pub outputs: Vec<Output>,
}

impl Robot {
    /// Returns a robot without sensors and noise, with the mass, friction and acceleration of an e-puck.
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
            color: None,
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

    /// Resolves references to parts of the mission. `at` is the robot's path in error messages.
    ///
    /// # Errors
    /// Returns an error if the mission lacks the patch on which batteries charge.
    pub fn settle(&mut self, layout: &Place, at: &str) -> Result<(), ParameterError> {
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

    /// Returns the maximum distance, metres from middle to middle, at which another robot affects the sensors.
    /// `largest` is the radius of the largest robot.
    #[inline]
    pub fn range(&self, largest: f32) -> f32 {
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

    /// Returns the distance between rims, metres, beyond which robots cannot touch within a tick.
    pub fn reach(&self) -> f32 {
        (self.fastest() * TICK).max(0.03)
    }

    /// Returns an upper bound for the speed at which two bodies approach each other, m/s.
    pub fn fastest(&self) -> f32 {
        // The noise deviates by at most 4.9 standard deviations.
        (2.0 * self.top_speed * (1.0 + 4.9 * self.wheel_noise)).max(0.3)
    }
}

/// Robots of the same model.
#[derive(Debug, Clone, PartialEq)]
pub struct Group {
    /// Name in pictures and metrics.
    pub name: String,
    /// The model.
    pub robot: Robot,
    /// Number of robots.
    pub count: usize,
    /// The start region as written; `None` for that of the mission.
    pub start: Option<Value>,
}
