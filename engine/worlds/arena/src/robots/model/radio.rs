//! Radios, as written in a model.

use serde::Deserialize;
use swarmwright_lanes::Number;
use swarmwright_simulation::ParameterError;
use swarmwright_simulation::parameters::wrong;

use super::limits::within;
use crate::math::functions::ln;
use crate::robots::parts::{Links, Radio};
use crate::time::TICK;

/// Limits and default of the path-loss exponent.
const EXPONENTS: [f32; 2] = [1.0, 10.0];
const EXPONENT: f32 = 3.0;
const MOST_FADING: u32 = 8;
const MOST_SLOTS: u32 = 10_000;
/// Limits in seconds.
const LONGEST_DELAY: f32 = 5.0;
const LONGEST_INTERVAL: f32 = 10.0;
/// Probability of reception so small that the 16-bit number of a link never lets a message through.
const FAINTEST: f64 = 1.0 / 262_144.0;

/// Imperfections of the communication between robots.
#[derive(Debug, Clone, Copy, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct RadioText {
    /// Shape parameter m of Nakagami fading, 1 for Rayleigh fading; by default, no fading.
    fading: Option<f64>,
    /// Path-loss exponent, with fading.
    exponent: Option<f32>,
    /// Number of messages that the channel carries in a tick; unlimited by default.
    slots: Option<f64>,
    /// Seconds between two messages of a robot; by default, one tick.
    interval: Option<f32>,
    /// Seconds between sending and reception.
    #[serde(default)]
    delay: f32,
    /// Whether robots, walls and objects block messages.
    #[serde(default = "yes")]
    line_of_sight: bool,
}

fn yes() -> bool {
    true
}

impl RadioText {
    /// Adds this radio to links; `at` is its path in error messages.
    pub(super) fn put(self, links: &mut Links, at: &str) -> Result<(), ParameterError> {
        // Read as any number, so that a single error states the full expectation.
        let count = |name: &str, number: f64, low: u32, high: u32| {
            if number.fract() == 0.0 && (f64::from(low)..=f64::from(high)).contains(&number) {
                return Ok(number as u32);
            }
            let reason = format!("{number} found, expected a whole number of {low} to {high}");
            Err(wrong(&format!("{at}.{name}"), reason))
        };
        let fading = match self.fading {
            Some(fading) => count("fading", fading, 1, MOST_FADING)?,
            None => 0,
        };
        let exponent = self.exponent.unwrap_or(EXPONENT);
        let name = format!("{at}.exponent");
        within(&name, exponent, EXPONENTS)?;
        if self.exponent.is_some() && fading == 0 {
            return Err(wrong(
                &name,
                "has no effect without fading; add fading: 1 (Rayleigh fading)",
            ));
        }
        let slots = self.slots.map(|slots| count("slots", slots, 2, MOST_SLOTS));
        let slots = slots.transpose()?;
        let interval = self.interval.unwrap_or(TICK);
        let interval = ticks(interval, TICK, LONGEST_INTERVAL, &format!("{at}.interval"))?;
        let delay = ticks(self.delay, 0.0, LONGEST_DELAY, &format!("{at}.delay"))?;
        links.radio = Some(Radio {
            fading,
            exponent,
            // ln(1 - 1/slots) per rival; the sum is the logarithm of the probability to be alone in a slot.
            crowding: slots.map_or(0.0, |slots| ln(Number::<f32>(1.0 - 1.0 / slots as f32)).0),
            interval,
            delay,
            line_of_sight: self.line_of_sight,
            stretch: stretch(fading, exponent),
        });
        Ok(())
    }
}

/// Converts a time to a number of ticks.
fn ticks(seconds: f32, low: f32, high: f32, name: &str) -> Result<u32, ParameterError> {
    within(name, seconds, [low, high])?;
    let ticks = f64::from(seconds) * 10.0;
    if (ticks - ticks.round()).abs() > 1e-4 {
        let reason = format!("{seconds} found, expected a multiple of 0.1 s, the length of a tick");
        return Err(wrong(name, reason));
    }
    Ok(ticks.round() as u32)
}

/// Returns the distance beyond which no message is received, in units of the range.
fn stretch(fading: u32, exponent: f32) -> f32 {
    if fading == 0 {
        return 1.0;
    }
    let heard = |threshold: f64| {
        let x = threshold * f64::from(fading);
        let terms = (1..fading).rev();
        (-x).exp() * terms.fold(1.0, |sum, k| 1.0 + sum * x / f64::from(k))
    };
    let (mut low, mut high) = (1.0, 64.0);
    for _ in 0..60 {
        let middle = (low + high) / 2.0;
        if heard(middle) < FAINTEST {
            high = middle;
        } else {
            low = middle;
        }
    }
    high.powf(1.0 / f64::from(exponent)) as f32
}
