//! Flags that robots carry home.

use std::ops::Range;

use serde::Deserialize;
use swarmwright_lanes::{Lanes, Mask, Number, number};

use crate::bodies::Bodies;
use crate::place::{LedColor, Place};
use crate::robots::Team;

/// A flag, which lies at a base. A robot that comes there carries it, until it is home or loses the flag; then the flag is
/// at its base again.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Flag {
    pub name: String,
    /// Name of the patch where it lies.
    pub base: String,
    /// The kind of robots that carry it, and the patch to which they bring it.
    pub robots: String,
    pub home: String,
    /// The kind that takes it back from a robot that is near.
    pub lost_to: String,
    /// Distance between the rims for that, metres.
    pub reach: f32,
    /// Colour of a robot that carries it, which cameras see.
    pub color: Option<LedColor>,
}

/// A flag, by indices of robots and patches.
#[derive(Debug, Clone)]
struct Carried {
    base: usize,
    home: usize,
    takers: Range<usize>,
    guards: Range<usize>,
    /// Square of the distance between the middles at which a guard takes it back, m^2.
    square: f32,
    color: Option<LedColor>,
}

/// The flags of a mission. Who carries them is in [`Bodies`].
#[derive(Debug, Clone, Default)]
pub(super) struct Flags(Vec<Carried>);

impl Flags {
    /// Finds robots and patches of each flag. All flags are at their bases.
    pub(super) fn new<L: Lanes>(
        rules: &[Flag],
        (team, layout): (&Team, &Place),
        bodies: &mut Bodies<L>,
    ) -> Self {
        let none = L::Mask::from_bits(0);
        let flag = |rule: &Flag| {
            let takers = bodies.named(Some(&rule.robots));
            let guards = bodies.named(Some(&rule.lost_to));
            let radius = |robots: &Range<usize>| match robots.is_empty() {
                true => 0.0,
                false => team.robot(robots.start).radius,
            };
            let far = radius(&takers) + radius(&guards) + rule.reach;
            Some(Carried {
                base: layout.index(&rule.base)?,
                home: layout.index(&rule.home)?,
                takers,
                guards,
                square: far * far,
                color: rule.color,
            })
        };
        let flags: Vec<Carried> = rules.iter().filter_map(flag).collect();
        bodies.carried.clear();
        bodies.carried.resize(flags.len() * bodies.len(), none);
        bodies.flags = rules.iter().map(|rule| rule.name.clone()).collect();
        bodies.brought.clear();
        bodies.brought.resize(flags.len(), none);
        Self(flags)
    }

    /// Brings the flags back to their bases in some lanes.
    #[inline(always)]
    pub(super) fn forget<L: Lanes>(lanes: L::Mask, bodies: &mut Bodies<L>) {
        for carried in &mut bodies.carried {
            *carried = carried.and_not(lanes);
        }
    }

    /// Robots bring flags home, lose them and take them.
    #[inline(always)]
    pub(super) fn update<L: Lanes>(&self, layout: &Place, bodies: &mut Bodies<L>) {
        for (index, flag) in self.0.iter().enumerate() {
            let first = index * bodies.len();
            let (base, home) = (
                &layout.patches[flag.base].shape,
                &layout.patches[flag.home].shape,
            );
            let mut brought = L::Mask::from_bits(0);
            let mut away = L::Mask::from_bits(0);
            for robot in flag.takers.clone() {
                let mut carries = bodies.carried[first + robot];
                if !carries.any() {
                    continue;
                }
                let at_home = carries.and(home.holds(bodies.x[robot], bodies.y[robot]));
                brought = brought.or(at_home);
                carries = carries.and_not(at_home);
                for guard in flag.guards.clone() {
                    let [x, y] = bodies.between(robot, guard);
                    let close = (x * x + y * y).le(number(flag.square));
                    carries = carries.and_not(free(close, guard, bodies));
                }
                if !bodies.caught.is_empty() {
                    carries = carries.and_not(bodies.caught[robot]);
                }
                bodies.carried[first + robot] = carries;
                away = away.or(carries);
            }
            for robot in flag.takers.clone() {
                let on = base.holds(bodies.x[robot], bodies.y[robot]).and_not(away);
                if !on.any() {
                    continue;
                }
                let takes = free(on, robot, bodies);
                bodies.carried[first + robot] = bodies.carried[first + robot].or(takes);
                away = away.or(takes);
            }
            bodies.brought[index] = brought;
        }
    }

    /// Writes the colours of flags to the robots that carry them.
    #[inline(always)]
    pub(super) fn show<L: Lanes>(&self, bodies: &Bodies<L>, shown: &mut [Number<L>]) {
        for (index, flag) in self.0.iter().enumerate() {
            let Some(color) = flag.color else {
                continue;
            };
            let carried = &bodies.carried[index * bodies.len()..];
            for (shown, carried) in shown.iter_mut().zip(carried) {
                *shown = number(color.code()).select(*shown, *carried);
            }
        }
    }
}

/// Returns the lanes in which a robot is not caught, of some.
#[inline(always)]
fn free<L: Lanes>(lanes: L::Mask, robot: usize, bodies: &Bodies<L>) -> L::Mask {
    match bodies.caught.get(robot) {
        Some(caught) => lanes.and_not(*caught),
        None => lanes,
    }
}
