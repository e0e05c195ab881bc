//! A simulation that the server offers.

use swarmwright_worlds::{Describer, Description, ParameterError, Parameters, Simulation};

use super::MAX_BATCH;
use crate::guard::guarded;

/// A simulation that is offered.
pub(super) struct Offer {
    pub(super) description: Description,
    /// Function that returns the description, if it depends on parameters.
    pub(super) describer: Option<Describer>,
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
            describer: simulation.describer(),
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
        match &self.describer {
            Some(describe) => describe(parameters),
            None => Ok(self.description.clone()),
        }
    }
}
