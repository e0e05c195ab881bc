//! Built-in models of robots.

use std::collections::BTreeMap;
use std::sync::LazyLock;

use serde_json::Value;

use super::composed;
use crate::robots::outputs::Output;
use crate::robots::parts::{Drive, GroundSensors, LightSensors, Links, Proximity, Ray, half_turns};
use crate::robots::robot::Robot;

/// Models composed of parts: one file each in `robots`, collected by `built_in.py`.
static MODELS: LazyLock<BTreeMap<String, Value>> =
    LazyLock::new(|| serde_json::from_str(include_str!("../../robots.json")).unwrap_or_default());

/// Directions of the e-puck's proximity and light sensors according to its manual, degrees counter-clockwise from ahead.
const E_PUCK_ANGLES: [f32; 8] = [17.0, 50.0, 90.0, 150.0, 210.0, 270.0, 310.0, 343.0];

impl Robot {
    /// Returns the e-puck of reference model RM1.1 or, with the inputs of Chocolate's modules, RM1.2
    /// (`../shared/data/argos`).
    fn e_puck(outputs: Vec<Output>) -> Self {
        let rays = (0..8).map(|index| {
            // Opposite rays are exact opposites, bit by bit.
            let angle = f64::from(index % 4) * 45.0 + 11.25;
            let (sin, cos) = angle.to_radians().sin_cos();
            let sign = if index < 4 { 1.0 } else { -1.0 };
            Ray {
                along: [cos as f32 * sign, sin as f32 * sign],
                reported: half_turns(E_PUCK_ANGLES[index as usize]),
            }
        });
        Self {
            wheel_noise: 0.05,
            proximity: Some(Proximity {
                rays: rays.collect(),
                opposed: true,
                start: 0.036,
                blind_inside: true,
                range: 0.05,
                response: [1.08212, -36.8961, 298.701],
                noise: 0.05,
            }),
            light: Some(LightSensors {
                angles: E_PUCK_ANGLES.map(half_turns).to_vec(),
                reach: 2.5,
                shadow: 0.0,
                noise: 0.05,
            }),
            ground: Some(GroundSensors {
                points: vec![[0.03, -0.009], [0.03, 0.0], [0.03, 0.009]],
                noise: 0.05,
            }),
            links: Some(Links {
                range: 0.7,
                loss: 0.85,
                radio: None,
            }),
            outputs,
            ..Self::bare(
                0.035,
                0.076,
                Drive::Differential { wheel_base: 0.053 },
                0.12,
            )
        }
    }

    /// Returns the model with this name.
    pub(super) fn preset(name: &str) -> Option<Self> {
        use Output::*;
        match name {
            "e-puck-rm1.1" => Some(Self::e_puck(vec![
                Proximity,
                Light,
                GroundDrawn,
                MessageCountSquashed,
                AttractionParts,
            ])),
            "e-puck-rm1.2" => Some(Self::e_puck(vec![
                ProximityVector,
                LightDirection,
                Ground,
                MessageCount,
                Attraction,
                Random,
            ])),
            _ => {
                let value = MODELS.get(name)?;
                composed::read(value, false).ok()
            }
        }
    }
}

/// Models defined in code instead of files.
const CODED: [&str; 2] = ["e-puck-rm1.1", "e-puck-rm1.2"];

/// Returns the names of all built-in robot models.
#[must_use]
pub fn robots() -> Vec<&'static str> {
    let models = MODELS.keys().map(String::as_str);
    CODED.into_iter().chain(models).collect()
}

/// Returns the names of all built-in robot models as a list for error messages.
pub(super) fn names() -> String {
    robots().join(", ")
}

/// Returns a suggestion for an unknown name.
pub(super) fn suggestion(name: &str) -> String {
    swarmwright_values::did_you_mean(name, robots())
}
