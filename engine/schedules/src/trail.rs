//! A small simulation whose fitness tells who computed it, with which seed, and whether a step was missed or made twice;
//! and the candidates that are evaluated in it.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

use serde_json::{Map, Value, json};
use swarmwright_controllers::Controller;
use swarmwright_pool::{Work, WorkError};
use swarmwright_worlds::{
    Description, Determinism, ParameterError, Parameters, Simulation, fail, rollout,
};
use swarmwright_wrapper::guarded;

use crate::random::mix;
use crate::schedule;
use crate::schedule::Kind;

/// Its title.
pub const TITLE: &str = "trail";
/// Agents of every episode.
pub const AGENTS: usize = 2;
/// A weight that drives the actuators of a [`Trail`] to an end: +1, which it gives up, or -1, which is deadly.
const EXTREME: f32 = 12.0;
/// The same for agents that steer themselves.
const EXTREME_SPEED: f32 = 1000.0;

/// Agents on a line. They start at 0, each moves by its actuator or, steered by parameters, by `speed`, and stops after
/// a number of steps of its own. The fitness weighs the places by agent.
pub struct Trail {
    title: &'static str,
    seed: f32,
    speed: Option<f32>,
    places: [f32; AGENTS],
    acting: Vec<u32>,
    step: u32,
    /// Set when the process that runs this would have died.
    died: Arc<AtomicBool>,
    /// Whether everything fails.
    broken: Arc<AtomicBool>,
}

impl Trail {
    /// A trail that tells with `died` that its process would have died, and fails as long as it is `broken`.
    #[must_use]
    pub fn new(title: &'static str, died: Arc<AtomicBool>, broken: Arc<AtomicBool>) -> Self {
        Self {
            title,
            seed: 0.0,
            speed: None,
            places: [0.0; AGENTS],
            acting: Vec::new(),
            step: 0,
            died,
            broken,
        }
    }

    fn last_step(&self, agent: u32) -> u32 {
        let odd = self.seed.rem_euclid(2.0) >= 1.0;
        2 + agent + u32::from(odd)
    }
}

impl Simulation for Trail {
    fn description(&self) -> Description {
        Description {
            title: self.title.into(),
            dimensions: 2,
            max_agents: Some(100),
            sensors: 2,
            actuators: 1,
            metrics: (&[][..]).into(),
            determinism: Determinism::Bitwise,
        }
    }

    fn reset(&mut self, parameters: &Parameters) -> Result<(), ParameterError> {
        if self.broken.load(Ordering::Relaxed) {
            fail("a library is missing".to_owned());
        }
        #[expect(
            clippy::cast_possible_truncation,
            reason = "small numbers, and binary32 on the wire"
        )]
        let number = |name: &str| Some(parameters.get(name)?.as_f64()? as f32);
        self.seed = number("seed").ok_or_else(|| ParameterError {
            name: "seed".to_owned(),
            reason: "is missing".to_owned(),
        })?;
        self.speed = number("speed");
        self.places = [0.0; AGENTS];
        self.acting = (0..).take(AGENTS).collect();
        self.step = 0;
        Ok(())
    }

    fn acting(&self) -> &[u32] {
        if self.speed.is_some() {
            &[]
        } else {
            &self.acting
        }
    }

    fn done(&self) -> bool {
        self.acting.is_empty()
    }

    fn sense(&self, agent: u32, sensors: &mut [f32]) {
        sensors[0] = self.places[agent as usize];
        sensors[1] = self.seed;
    }

    fn step(&mut self, actuators: &[f32]) {
        let extreme = |bound: f32| {
            let speed = self.speed.iter().map(|speed| speed / EXTREME_SPEED);
            speed
                .chain(actuators.iter().copied())
                .any(|number| number / bound >= 0.999)
        };
        if extreme(1.0) {
            fail("an agent ran away".to_owned());
        }
        if extreme(-1.0) {
            self.died.store(true, Ordering::Relaxed);
            fail("the process died".to_owned());
        }
        for (row, &agent) in self.acting.iter().enumerate() {
            let step = self
                .speed
                .or_else(|| actuators.get(row).copied())
                .unwrap_or(f32::NAN);
            self.places[agent as usize] += step + self.seed / 64.0;
        }
        self.step += 1;
        let (step, acting) = (self.step, std::mem::take(&mut self.acting));
        self.acting = acting
            .into_iter()
            .filter(|&agent| step < self.last_step(agent))
            .collect();
    }

    fn fitness(&self) -> f64 {
        let [first, second] = self.places.map(f64::from);
        first + 3.0 * second
    }

    fn duplicate(&self) -> Option<Box<dyn Simulation>> {
        let (died, broken) = (Arc::clone(&self.died), Arc::clone(&self.broken));
        Some(Box::new(Self::new(self.title, died, broken)))
    }
}

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
