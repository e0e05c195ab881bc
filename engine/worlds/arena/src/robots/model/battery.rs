//! Batteries, as written in a model.

use serde::Deserialize;
use swarmwright_simulation::ParameterError;
use swarmwright_simulation::parameters::wrong;

use super::limits::{SHARE, within};
use crate::robots::parts::{Battery, Charging};

/// Limits of the times for discharging and charging, seconds.
const TIMES: [f32; 2] = [1.0, 1e6];

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct BatteryText {
    /// Seconds that a full battery lasts while the robot stands.
    standing: f32,
    /// Seconds that a full battery lasts while the robot drives at its maximum.
    driving: f32,
    /// Charge at the start, 0..=1.
    #[serde(default = "full")]
    charge: f32,
    charging: Option<ChargingText>,
}

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct ChargingText {
    /// Name of a patch of the mission's floor.
    patch: String,
    /// Seconds from empty to full.
    duration: f32,
}

fn full() -> f32 {
    1.0
}

impl BatteryText {
    pub(super) fn read(self) -> Result<Battery, ParameterError> {
        within("battery.standing", self.standing, TIMES)?;
        within("battery.driving", self.driving, TIMES)?;
        within("battery.charge", self.charge, SHARE)?;
        if self.driving > self.standing {
            return Err(wrong(
                "battery.driving",
                format!(
                    "{} found, expected seconds, at most the {} while standing",
                    self.driving, self.standing
                ),
            ));
        }
        let charging = match self.charging {
            None => None,
            Some(ChargingText { patch, duration }) => {
                within("battery.charging.duration", duration, TIMES)?;
                Some(Charging {
                    name: patch,
                    patch: 0,
                    duration,
                })
            }
        };
        Ok(Battery {
            standing: self.standing,
            driving: self.driving,
            charge: self.charge,
            charging,
        })
    }
}
