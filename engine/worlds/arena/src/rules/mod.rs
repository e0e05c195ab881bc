//! Rules of a mission: what happens to robots and objects beside their motion.

mod captures;
mod flags;
mod restart;

use swarmwright_lanes::{Lanes, Number, number};

use crate::bodies::Bodies;
use crate::place::{LedColor, Place};
use crate::robots::Team;
use captures::Captures;
use flags::Flags;
use restart::Restarts;

pub use captures::Capture;
pub use flags::Flag;
pub use restart::Restart;

/// States of robots in pictures.
pub const CARRIES: &str = "carries a flag";
pub const CAUGHT: &str = "caught";

/// The rules of a mission.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Rules {
    pub captures: Vec<Capture>,
    pub flags: Vec<Flag>,
    pub restart: Option<Restart>,
}

impl Rules {
    /// Returns whether robots of a kind may be caught.
    pub fn catch(&self, kind: &str) -> bool {
        self.captures.iter().any(|capture| capture.robots == kind)
    }

    /// Returns whether robots of a kind may carry a flag.
    pub fn carry(&self, kind: &str) -> bool {
        self.flags.iter().any(|flag| flag.robots == kind)
    }

    /// Returns whether there are none.
    #[inline]
    pub fn are_none(&self) -> bool {
        self.captures.is_empty() && self.flags.is_empty() && self.restart.is_none()
    }
}

/// Applies the rules in the episodes of all lanes.
pub struct Referee<L: Lanes> {
    captures: Captures,
    flags: Flags,
    restarts: Option<Restarts<L>>,
    /// Whether the mission has rules.
    active: bool,
}

impl<L: Lanes> Referee<L> {
    pub fn new() -> Self {
        Self {
            captures: Captures::default(),
            flags: Flags::default(),
            restarts: None,
            active: false,
        }
    }

    /// Starts an episode in each lane, with everything at its start pose.
    pub fn start(
        &mut self,
        rules: &Rules,
        (team, layout): (&Team, &Place),
        bodies: &mut Bodies<L>,
    ) {
        bodies.caught.clear();
        bodies.carried.clear();
        bodies.brought.clear();
        self.active = !rules.are_none();
        if !self.active {
            return;
        }
        self.captures = Captures::new(&rules.captures, team, bodies);
        self.flags = Flags::new(&rules.flags, (team, layout), bodies);
        let restart = rules.restart.as_ref();
        self.restarts = restart.map(|restart| Restarts::new(restart, layout, bodies));
    }

    /// Returns whether the mission has rules.
    #[inline(always)]
    pub fn is_active(&self) -> bool {
        self.active
    }

    /// Applies the rules after the motion of a tick.
    #[inline(always)]
    pub fn update(&mut self, layout: &Place, bodies: &mut Bodies<L>) {
        if let Some(restarts) = &mut self.restarts {
            let restarted = restarts.update(layout, bodies);
            Flags::forget(restarted, bodies);
        }
        self.captures.update(bodies);
        self.flags.update(layout, bodies);
    }

    /// Writes the colours that robots show, apart from those of LEDs. `shown` is empty if no robot sees colours.
    #[inline(always)]
    pub fn show(&self, team: &Team, bodies: &Bodies<L>, shown: &mut [Number<L>]) {
        for (robot, shown) in shown.iter_mut().enumerate() {
            let robot = team.robot(robot);
            if robot.leds.is_empty() {
                *shown = number(robot.color.map_or(0.0, LedColor::code));
            }
        }
        self.flags.show(bodies, shown);
        for (shown, caught) in shown.iter_mut().zip(&bodies.caught) {
            *shown = number(0.0).select(*shown, *caught);
        }
    }
}
