//! A simulation that the server offers.

use swarmwright_worlds::{Description, ParameterError, Parameters, Simulation, described};

use super::MAX_BATCH;
use crate::guard::guarded;

/// A simulation that is offered.
pub(super) struct Offer {
    pub(super) description: Description,
    /// Whether the description depends on parameters.
    pub(super) varies: bool,
    /// Most episodes of a batch.
    pub(super) batch: usize,
    /// Whether the simulation steps the episodes of a batch by itself.
    pub(super) together: bool,
    /// Episodes that are computed in about the time of one.
    pub(super) lanes: usize,
    /// Whether it has scenes.
    pub(super) scenes: bool,
    /// None while it is at work elsewhere: in a job, or in a batch.
    pub(super) simulation: Option<Box<dyn Simulation>>,
    /// Duplicates from batches before, for the next one of the same tool.
    pub(super) spares: Vec<Box<dyn Simulation>>,
}

impl Offer {
    pub(super) fn new(mut simulation: Box<dyn Simulation>) -> Self {
        let several = matches!(guarded(|| simulation.duplicate()), Ok(Some(_)));
        let together = several && simulation.together().is_some();
        let lanes = simulation.lanes();
        let most = if together {
            MAX_BATCH.min(lanes)
        } else {
            MAX_BATCH
        };
        Self {
            description: simulation.description(),
            varies: simulation.varies(),
            batch: if several { most } else { 1 },
            together,
            lanes,
            scenes: simulation.has_scenes(),
            simulation: Some(simulation),
            spares: Vec::new(),
        }
    }

    /// The description with these parameters.
    pub(super) fn described(&self, parameters: &Parameters) -> Result<Description, ParameterError> {
        let known = || Ok(self.description.clone());
        if !self.varies {
            return known();
        }
        match described(&self.description.title, parameters) {
            Some(description) => description.map(std::borrow::Cow::into_owned),
            None => known(),
        }
    }
}
