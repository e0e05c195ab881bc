//! The candidates that are evaluated in a [`Trail`], and their fitness in an undisturbed run.

use std::sync::Arc;

use serde_json::{Map, Value, json};
use swarmwright_controllers::Controller;
use swarmwright_pool::{Work, WorkError};
use swarmwright_testing::{AGENTS, EXTREME_SPEED, Trail};
use swarmwright_worlds::rollout;
use swarmwright_wrapper::guarded;

use crate::random::mix;
use crate::schedule;
use crate::schedule::Kind;

/// Its title.
pub const TITLE: &str = "trail";
/// A weight that drives the actuators of a [`Trail`] to an end: +1, which it gives up, or -1, which is deadly.
const EXTREME: f32 = 12.0;

/// The controllers of all candidates of a kind.
#[must_use]
pub fn architecture(kind: Kind) -> Value {
    match kind {
        Kind::Layered => {
            json!({"version": 1, "kind": "layered", "sensors": 2, "actuators": 1, "hidden": [],
            "activation": "tanh", "output_range": [-1, 1]})
        }
        Kind::FullyMeshed => {
            json!({"version": 1, "kind": "fully_meshed", "sensors": 2, "actuators": 1,
            "hidden": 0, "activation": "tanh", "iterations": 2, "output_range": [-1, 1]})
        }
        Kind::ParameterSet => json!({"version": 1, "kind": "parameter_set",
            "parameters": [{"name": "speed", "type": "real"}]}),
    }
}

const fn weights(kind: Kind) -> usize {
    match kind {
        Kind::Layered => 3,
        Kind::FullyMeshed => 4,
        Kind::ParameterSet => 1,
    }
}

/// The genome of a candidate. `salt`: another one for every work.
#[must_use]
pub fn genome(work: &schedule::Work, salt: u64, candidate: usize) -> Vec<f32> {
    let extreme = match work.kind {
        Kind::ParameterSet => EXTREME_SPEED,
        Kind::Layered | Kind::FullyMeshed => EXTREME,
    };
    let count = weights(work.kind);
    if work.failing.contains(&candidate) {
        return vec![extreme; count];
    }
    if work.deadly.contains(&candidate) {
        return vec![-extreme; count];
    }
    // Of -0.25 to 0.25: with sensors of this size the actuators stay away from the ends.
    let weight = |index: usize| {
        let bits = mix(&[salt, candidate as u64, index as u64]) >> 52;
        #[expect(clippy::cast_precision_loss, reason = "12 bits")]
        let share = bits as f32 / 4096.0;
        share / 2.0 - 0.25
    };
    (0..count).map(weight).collect()
}

/// The seeds of a work's episodes.
#[must_use]
pub fn seeds(work: &schedule::Work) -> Vec<u64> {
    (1..).take(work.episodes).collect()
}

/// What a pool is given to have some candidates evaluated.
///
/// # Errors
/// None.
pub fn work(plan: &schedule::Work, salt: u64, candidates: &[usize]) -> Result<Work, WorkError> {
    let genomes = candidates
        .iter()
        .flat_map(|&candidate| genome(plan, salt, candidate));
    Work::new(
        &architecture(plan.kind).to_string(),
        genomes.collect(),
        seeds(plan),
    )
}

/// Parameters of all episodes.
#[must_use]
pub fn parameters() -> Map<String, Value> {
    let mut parameters = Map::new();
    parameters.insert("numAgents".to_owned(), AGENTS.into());
    parameters
}

/// What comes out of an undisturbed evaluation of every candidate in every episode, row-major; none where the
/// simulation gives up or dies.
///
/// # Errors
/// None.
pub fn expected(plan: &schedule::Work, salt: u64) -> Result<Vec<Option<f64>>, WorkError> {
    let all: Vec<usize> = (0..plan.candidates).collect();
    let work = work(plan, salt, &all)?;
    let mut trail = Trail::new(TITLE, Arc::default(), Arc::default());
    let mut results = Vec::new();
    for candidate in all {
        let genome = work.genomes_of(candidate..candidate + 1);
        let controller = Controller::with_weights(work.architecture(), genome.into()).ok();
        for &seed in work.seeds() {
            let mut parameters = parameters();
            parameters.insert("seed".to_owned(), seed.into());
            let run = || rollout(&mut trail, &parameters, controller.as_ref()?).ok();
            results.push(guarded(run).ok().flatten());
        }
    }
    Ok(results)
}
