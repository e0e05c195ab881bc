//! Rules of a mission: what happens to robots and objects beside their motion.

mod captures;
mod restart;

use serde::Deserialize;
use swarmwright_lanes::Lanes;

use crate::bodies::Bodies;
use crate::place::Place;
use crate::robots::Team;
use captures::Captures;
use restart::Restarts;

/// State of caught robots in pictures.
pub(crate) const CAUGHT: &str = "caught";

/// Robots of a kind are caught as soon as one of another kind is near: from then on they stand, show no colour and are
/// not heard.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct Capture {
    /// The kind that is caught.
    pub robots: String,
    /// The kind that catches.
    pub by: String,
    /// Distance between the rims, metres.
    pub reach: f32,
}

/// All robots and objects return to their start poses in the tick after an object came to a patch.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct Restart {
    pub object: String,
    /// Names of patches.
    pub on: Vec<String>,
}

/// The rules of a mission.
#[derive(Debug, Clone, PartialEq, Default)]
pub(crate) struct Rules {
    pub captures: Vec<Capture>,
    pub restart: Option<Restart>,
}

impl Rules {
    /// Returns whether robots of a kind may be caught.
    pub(crate) fn catch(&self, kind: &str) -> bool {
        self.captures.iter().any(|capture| capture.robots == kind)
    }

    /// Returns whether there are none.
    pub(crate) fn are_none(&self) -> bool {
        self.captures.is_empty() && self.restart.is_none()
    }
}

/// Applies the rules in the episodes of all lanes.
pub(crate) struct Referee<L: Lanes> {
    captures: Captures,
    restarts: Option<Restarts<L>>,
    /// Whether the mission has rules.
    active: bool,
}

impl<L: Lanes> Referee<L> {
    pub(crate) fn new() -> Self {
        Self {
            captures: Captures::default(),
            restarts: None,
            active: false,
        }
    }

    /// Starts an episode in each lane, with everything at its start pose.
    pub(crate) fn start(
        &mut self,
        rules: &Rules,
        (team, layout): (&Team, &Place),
        bodies: &mut Bodies<L>,
    ) {
        bodies.caught.clear();
        self.active = !rules.are_none();
        if !self.active {
            return;
        }
        self.captures = Captures::new(&rules.captures, team, bodies);
        let restart = rules.restart.as_ref();
        self.restarts = restart.map(|restart| Restarts::new(restart, layout, bodies));
    }

    /// Returns whether the mission has rules.
    #[inline(always)]
    pub(crate) fn is_active(&self) -> bool {
        self.active
    }

    /// Applies the rules after the motion of a tick.
    #[inline(always)]
    pub(crate) fn update(&mut self, layout: &Place, bodies: &mut Bodies<L>) {
        if let Some(restarts) = &mut self.restarts {
            restarts.update(layout, bodies);
        }
        self.captures.update(bodies);
    }
}
