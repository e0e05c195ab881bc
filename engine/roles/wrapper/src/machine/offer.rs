//! Simulations that the server offers.

use swarmwright_worlds::{Describer, Description, ParameterError, Parameters, Side, Simulation};

use super::MAX_BATCH;
use crate::guard::guarded;

/// An offered simulation.
pub(super) struct Offer {
    pub(super) description: Description,
    /// Function that returns the description, if it depends on parameters.
    pub(super) describer: Option<Describer>,
    /// Largest number of episodes of a batch.
    pub(super) batch: usize,
    /// Whether the simulation steps the episodes of a batch together.
    pub(super) together: bool,
    /// Number of episodes that are computed in about the time of one.
    pub(super) lanes: usize,
    /// Sides of a match.
    pub(super) sides: Vec<Side>,
    /// Whether it has scenes.
    pub(super) scenes: bool,
    /// The simulation; `None` while a job or a batch uses it.
    pub(super) simulation: Option<Box<dyn Simulation>>,
    /// Duplicates from earlier batches, for the next batch of the same tool.
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
            sides: guarded(|| simulation.sides()).unwrap_or_default(),
            scenes: simulation.has_scenes(),
            simulation: Some(simulation),
            spares: Vec::new(),
        }
    }

    /// Returns the description for these parameters.
    pub(super) fn described(&self, parameters: &Parameters) -> Result<Description, ParameterError> {
        match &self.describer {
            Some(describe) => describe(parameters),
            None => Ok(self.description.clone()),
        }
    }
}
