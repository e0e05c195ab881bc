//! Failures of robots during an episode, and degraded links.

use std::ops::Range;

use serde::Deserialize;
use serde_json::Value;
use swarmwright_lanes::{Lanes, Mask, Number, number};
use swarmwright_simulation::ParameterError;
use swarmwright_simulation::counter::uniform;
use swarmwright_simulation::parameters::wrong;

use crate::bodies::Bodies;
use crate::math::functions::either;
use crate::mistakes::{Mistakes, mismatch_at};
use crate::robots::{MOST_ROBOTS, Team};
use crate::time::LONGEST;

/// Identifies the random stream that chooses the failing robots.
const STREAM: u64 = 0x0066_6169_6c75_7265;
/// Maximum number of failures in an episode.
const MOST_FAILURES: usize = 16;

/// A failure that affects some robots for a limited time.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(rename_all = "snake_case", deny_unknown_fields)]
pub enum Failure {
    /// The robots stand still.
    Stop {
        share: f64,
        robots: Option<String>,
        #[serde(default)]
        at: f64,
        until: Option<f64>,
    },
    /// The robots drive at this fraction of the commanded speed.
    Slow {
        share: f64,
        robots: Option<String>,
        factor: f32,
        #[serde(default)]
        at: f64,
        until: Option<f64>,
    },
    /// All sensor values of the robots are 0.
    Blind {
        share: f64,
        robots: Option<String>,
        #[serde(default)]
        at: f64,
        until: Option<f64>,
    },
    /// No other robot receives their messages.
    Mute {
        share: f64,
        robots: Option<String>,
        #[serde(default)]
        at: f64,
        until: Option<f64>,
    },
    /// Messages of all robots are lost with this probability, in addition to the robots' own loss.
    Loss {
        loss: f32,
        #[serde(default)]
        at: f64,
        until: Option<f64>,
    },
}

impl Failure {
    /// Returns the share of affected robots, and the start and end in seconds.
    fn scope(&self) -> (f64, f64, Option<f64>) {
        match *self {
            Self::Stop {
                share, at, until, ..
            }
            | Self::Slow {
                share, at, until, ..
            }
            | Self::Blind {
                share, at, until, ..
            }
            | Self::Mute {
                share, at, until, ..
            } => (share, at, until),
            Self::Loss { at, until, .. } => (1.0, at, until),
        }
    }

    /// Returns the kind of robots affected; `None` for all kinds.
    #[inline]
    pub fn robots(&self) -> Option<&str> {
        match self {
            Self::Stop { robots, .. }
            | Self::Slow { robots, .. }
            | Self::Blind { robots, .. }
            | Self::Mute { robots, .. } => robots.as_deref(),
            Self::Loss { .. } => None,
        }
    }

    /// Returns whether the failure is active in a tick. Ticks count from 1, which is the start at 0 s.
    #[inline]
    fn active(&self, tick: u32) -> bool {
        let (.., until) = self.scope();
        self.active_by(tick)
            && until.is_none_or(|until| f64::from(tick - 1) < (until * 10.0).round())
    }

    fn check(&self) -> Result<(), (&'static str, String)> {
        let (share, at, until) = self.scope();
        let within = |name, number: f64, low: f64, high: f64| {
            if (low..=high).contains(&number) {
                return Ok(());
            }
            Err((name, format!("{number} found, expected {low} to {high}")))
        };
        within("share", share, 0.0, 1.0)?;
        within("at", at, 0.0, LONGEST)?;
        match *self {
            Self::Slow { factor, .. } => within("factor", factor.into(), 0.0, 1.0)?,
            Self::Loss { loss, .. } => within("loss", loss.into(), 0.0, 1.0)?,
            _ => (),
        }
        match until {
            Some(until) if !(until > at && until <= LONGEST) => Err((
                "until",
                format!("{until} found, expected seconds after {at}, at most {LONGEST}"),
            )),
            _ => Ok(()),
        }
    }

    /// Returns the number of affected robots among `robots`: the requested share, rounded to whole robots.
    fn count(&self, robots: usize) -> usize {
        let (share, ..) = self.scope();
        (share * robots as f64).round() as usize
    }

    /// Checks that the failure has an effect in an episode with `ticks` ticks and `robots` robots. A share of 0 is
    /// valid: it asks for no failures.
    pub fn check_effect(&self, ticks: u32, robots: usize) -> Result<(), (&'static str, String)> {
        let (share, at, _) = self.scope();
        if !self.active_by(ticks) {
            return Err((
                "at",
                format!(
                    "{at} s found, but the episode ends after {} s: expected less",
                    f64::from(ticks) / 10.0
                ),
            ));
        }
        if share > 0.0 && self.count(robots) == 0 {
            return Err((
                "share",
                format!(
                    "{share} of {robots} {} is less than half a robot: expected 0, or at least {:.4}",
                    if robots == 1 { "robot" } else { "robots" },
                    0.5 / robots as f64
                ),
            ));
        }
        Ok(())
    }

    /// Returns whether the failure begins in one of the ticks from 1 to `last`.
    fn active_by(&self, last: u32) -> bool {
        let (_, at, _) = self.scope();
        // Compare whole tenths of a second.
        (at * 10.0).round() < f64::from(last)
    }

    /// Chooses the affected robots by the seed.
    #[inline]
    fn chosen(&self, index: usize, robots: usize, of: Range<usize>, seed: u64) -> Vec<bool> {
        let count = self.count(of.len());
        let mut order: Vec<(u32, usize)> = of
            .map(|robot| {
                let counter = index as u64 * u64::from(MOST_ROBOTS) + robot as u64;
                // The bit patterns of numbers from 0 to 1 have the same order as the numbers.
                (uniform(seed, STREAM, counter).to_bits(), robot)
            })
            .collect();
        order.sort_unstable();
        let mut chosen = vec![false; robots];
        for (_, robot) in &order[..count.min(order.len())] {
            chosen[*robot] = true;
        }
        chosen
    }
}

/// Reads a list of failures; `path` is its path in error messages.
///
/// # Errors
/// Returns all mistakes in the list.
pub fn read(value: &Value, path: &str) -> Result<Vec<Failure>, Mistakes> {
    let Some(items) = value.as_array() else {
        return Err(wrong(
            path,
            format!("{value} found, expected a list such as [{{kind: stop, share: 0.2, at: 30}}]"),
        )
        .into());
    };
    if items.len() > MOST_FAILURES {
        return Err(wrong(
            path,
            format!(
                "{} found, at most {MOST_FAILURES} are possible",
                items.len()
            ),
        )
        .into());
    }
    let read_one = |index: usize, item: &Value| -> Result<Failure, ParameterError> {
        let at = format!("{path}[{index}]");
        let failure: Failure =
            swarmwright_values::read_kind(item).map_err(|mismatch| mismatch_at(&at, mismatch))?;
        failure
            .check()
            .map_err(|(name, reason)| wrong(&format!("{at}.{name}"), reason))?;
        Ok(failure)
    };
    let mut mistakes = Mistakes::default();
    let mut failures = Vec::new();
    for (index, item) in items.iter().enumerate() {
        failures.extend(mistakes.take(read_one(index, item)));
    }
    mistakes.or(Some(failures))
}

/// The robots that fail in the episodes of the lanes.
pub struct Failing<L: Lanes> {
    /// For each failure, the lanes in which it affects each robot.
    befallen: Vec<(Failure, Vec<L::Mask>)>,
}

impl<L: Lanes> Failing<L> {
    pub fn new() -> Self {
        Self {
            befallen: Vec::new(),
        }
    }

    /// Starts an episode in each lane.
    #[inline(always)]
    pub fn start(&mut self, failures: &[Failure], bodies: &Bodies<L>, seed: impl Fn(usize) -> u64) {
        self.befallen.clear();
        for (index, failure) in failures.iter().enumerate() {
            let robots = bodies.len();
            let of = bodies.named(failure.robots());
            let mut bits = vec![0_u64; robots];
            for lane in 0..L::WIDTH {
                let chosen = failure.chosen(index, robots, of.clone(), seed(lane));
                for (bits, chosen) in bits.iter_mut().zip(chosen) {
                    *bits |= u64::from(chosen) << lane;
                }
            }
            let masks = bits.into_iter().map(L::Mask::from_bits).collect();
            self.befallen.push((failure.clone(), masks));
        }
    }

    /// Writes the commands that reach the drives in a tick. Returns `false`, and writes nothing, if no failure changes
    /// them.
    #[inline(always)]
    pub fn tell(&self, tick: u32, actuators: &[L], team: &Team, commands: &mut Vec<L>) -> bool {
        let slowed = |failure: &Failure| match failure {
            Failure::Stop { .. } if failure.active(tick) => Some(0.0),
            Failure::Slow { factor, .. } if failure.active(tick) => Some(*factor),
            _ => None,
        };
        if !self
            .befallen
            .iter()
            .any(|(failure, _)| slowed(failure).is_some())
        {
            return false;
        }
        commands.clear();
        commands.extend_from_slice(actuators);
        for (failure, masks) in &self.befallen {
            let Some(factor) = slowed(failure) else {
                continue;
            };
            let rows = commands.chunks_exact_mut(team.actuators()).zip(masks);
            for (index, (row, mask)) in rows.enumerate() {
                for command in &mut row[team.drive(index)] {
                    *command = (Number(*command) * factor)
                        .select(Number(*command), *mask)
                        .0;
                }
            }
        }
        true
    }

    /// Sets the sensor values of blind robots to 0.
    #[inline(always)]
    pub fn blind(&self, tick: u32, width: usize, outputs: &mut [L]) {
        for (failure, masks) in &self.befallen {
            if matches!(failure, Failure::Blind { .. }) && failure.active(tick) {
                for (row, mask) in outputs.chunks_exact_mut(width).zip(masks) {
                    for output in row {
                        *output = number::<L>(0.0).select(Number(*output), *mask).0;
                    }
                }
            }
        }
    }

    /// Writes the lanes in which each robot is mute in a tick; leaves `mute` empty if no robot is.
    #[inline(always)]
    pub fn mute(&self, tick: u32, robots: usize, mute: &mut Vec<L::Mask>) {
        mute.clear();
        for (failure, masks) in &self.befallen {
            if matches!(failure, Failure::Mute { .. }) && failure.active(tick) {
                mute.resize(robots, L::Mask::from_bits(0));
                for (mute, mask) in mute.iter_mut().zip(masks) {
                    *mute = mute.or(*mask);
                }
            }
        }
    }

    /// Returns the probability with which failures lose messages in a tick; `None` without such failures.
    pub fn loss(&self, tick: u32) -> Option<f32> {
        let losses = self
            .befallen
            .iter()
            .filter_map(|(failure, _)| match failure {
                Failure::Loss { loss, .. } if failure.active(tick) => Some(*loss),
                _ => None,
            });
        losses.reduce(either)
    }
}

impl Failing<f32> {
    /// Returns the state shown in scenes for a robot that fails in a tick; of several failures, the most severe one.
    pub fn state(&self, tick: u32, robot: usize) -> Option<&'static str> {
        let befallen = self.befallen.iter().filter(|(failure, masks)| {
            failure.active(tick) && masks.get(robot).is_some_and(|mask| mask.any())
        });
        let states = befallen.filter_map(|(failure, _)| match failure {
            Failure::Stop { .. } => Some((0, "stopped")),
            Failure::Blind { .. } => Some((1, "blind")),
            Failure::Mute { .. } => Some((2, "mute")),
            Failure::Slow { .. } => Some((3, "slow")),
            Failure::Loss { .. } => None,
        });
        states.min().map(|(_, state)| state)
    }
}
