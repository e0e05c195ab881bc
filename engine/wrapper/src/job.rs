//! One request for offloaded evaluation at work: every candidate in every episode, on whatever thread runs it.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

use serde_json::{Map, Value};
use swarmwright_controllers::{Architecture, Controller};
use swarmwright_protocol::{Failure, Refusal, RefusalKind};
use swarmwright_worlds::{Block, Means, Parameters, RolloutError, Simulation, rollout};

use crate::guard::{finite, guarded};

/// Candidates that are evaluated at once, at first; then as many as keep the time between two looks at the abort flag
/// within these bounds.
const FIRST_PART: usize = 256;
const SHORT: Duration = Duration::from_millis(10);
const LONG: Duration = Duration::from_millis(50);

/// What requests that follow each other usually have in common.
#[derive(Debug)]
pub(crate) struct Setup {
    /// Index of the simulation among those that the server offers.
    pub simulation: usize,
    /// The specification as it came.
    pub controller: Map<String, Value>,
    pub architecture: Architecture,
    pub parameters: Parameters,
}

/// A request that was found to be sound.
#[derive(Debug)]
pub(crate) struct Request {
    pub number: u64,
    pub reply: String,
    pub setup: Arc<Setup>,
    pub genomes: Vec<f32>,
    pub seeds: Vec<u64>,
    /// When the tool gives the work to somebody else.
    pub expires: Option<Instant>,
}

impl Request {
    /// Number of candidates.
    pub fn candidates(&self) -> usize {
        self.genomes.len() / self.setup.architecture.weight_count()
    }

    /// Bytes held.
    pub fn size(&self) -> usize {
        self.genomes.len() * 4 + self.seeds.len() * 8
    }
}

/// A request at work, with the simulation that it needs. Give what [`run`](Self::run) returns to
/// [`Machine::finished`](crate::Machine::finished).
pub struct Job {
    pub(crate) request: Request,
    pub(crate) simulation: Box<dyn Simulation>,
    pub(crate) abort: Arc<AtomicBool>,
}

/// A request that was worked on.
pub struct Done {
    pub(crate) request: Request,
    pub(crate) simulation: Box<dyn Simulation>,
    pub(crate) result: Result<Evaluation, Refusal>,
    pub(crate) seconds: f64,
}

/// Fitness of candidates x episodes, row-major, NaN where `failed` says why.
#[derive(Debug, Default)]
pub(crate) struct Evaluation {
    pub fitness: Vec<f64>,
    pub failed: Vec<Failure>,
}

impl std::fmt::Debug for Job {
    fn fmt(&self, formatter: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        formatter
            .debug_struct("Job")
            .field("request", &self.request)
            .finish_non_exhaustive()
    }
}

impl Job {
    /// Number of episodes to compute.
    #[must_use]
    pub fn episodes(&self) -> usize {
        self.request.candidates() * self.request.seeds.len()
    }

    /// Computes. The fitness does not depend on `means`.
    #[must_use]
    pub fn run(mut self, means: Means) -> Done {
        let start = Instant::now();
        let result = evaluate(&mut *self.simulation, &self.request, means, &self.abort);
        Done {
            request: self.request,
            simulation: self.simulation,
            result,
            seconds: start.elapsed().as_secs_f64(),
        }
    }
}

/// The whole block in parts, until it is done or not wanted any more.
fn evaluate(
    simulation: &mut dyn Simulation,
    request: &Request,
    means: Means,
    abort: &AtomicBool,
) -> Result<Evaluation, Refusal> {
    let setup = &*request.setup;
    let weights = setup.architecture.weight_count();
    let mut evaluation = Evaluation::default();
    let mut rest = &request.genomes[..];
    let mut part = FIRST_PART;
    let mut first = 0;
    while !rest.is_empty() && !abort.load(Ordering::Relaxed) {
        let start = Instant::now();
        let candidates = part.min(rest.len() / weights);
        let genomes;
        (genomes, rest) = rest.split_at(candidates * weights);
        let block = Block {
            architecture: &setup.architecture,
            genomes,
            parameters: &setup.parameters,
            seeds: &request.seeds,
        };
        evaluate_part(simulation, &block, means, abort, first, &mut evaluation)?;
        first += candidates;
        let elapsed = start.elapsed();
        if elapsed < SHORT {
            part *= 2;
        } else if elapsed > LONG {
            part = (part / 2).max(1);
        }
    }
    Ok(evaluation)
}

fn evaluate_part(
    simulation: &mut dyn Simulation,
    block: &Block<'_>,
    means: Means,
    abort: &AtomicBool,
    first: usize,
    evaluation: &mut Evaluation,
) -> Result<(), Refusal> {
    match guarded(|| simulation.evaluate(block, means)) {
        Ok(Some(Ok(fitness))) if fitness.len() == block.len() => {
            for (index, value) in fitness.into_iter().enumerate() {
                evaluation.push(first, index, block.seeds.len(), finite(value));
            }
            Ok(())
        }
        Ok(Some(Err(error))) if is_refusal(&error) => Err(invalid(error.to_string())),
        // It leaves that to us; or something failed, and one by one it can be seen what.
        _ => one_by_one(simulation, block, abort, first, evaluation),
    }
}

fn one_by_one(
    simulation: &mut dyn Simulation,
    block: &Block<'_>,
    abort: &AtomicBool,
    first: usize,
    evaluation: &mut Evaluation,
) -> Result<(), Refusal> {
    let episodes = block.seeds.len();
    let parameters: Vec<Parameters> = (0..episodes)
        .map(|episode| block.parameters_of(episode))
        .collect();
    let architecture = Arc::new(block.architecture.clone());
    for candidate in 0..block.candidates() {
        let controller = Controller::with_weights(&architecture, block.genome(candidate).into())
            .map_err(|error| {
                invalid(format!("genomes: candidate {}: {error}", first + candidate))
            })?;
        for (episode, parameters) in parameters.iter().enumerate() {
            if abort.load(Ordering::Relaxed) {
                return Ok(());
            }
            let result = match guarded(|| rollout(simulation, parameters, &controller)) {
                Ok(Ok(fitness)) => finite(fitness),
                Ok(Err(error)) if is_refusal(&error) => {
                    return Err(invalid(error.to_string()));
                }
                Ok(Err(error)) => Err(error.to_string()),
                Err(reason) => Err(reason),
            };
            evaluation.push(first, candidate * episodes + episode, episodes, result);
        }
    }
    Ok(())
}

impl Evaluation {
    /// `first`: the candidate at which the part begins; `index`: within the part.
    fn push(&mut self, first: usize, index: usize, episodes: usize, result: Result<f64, String>) {
        self.fitness.push(match result {
            Ok(fitness) => fitness,
            Err(reason) => {
                self.failed.push(Failure {
                    candidate: (first + index / episodes) as u64,
                    episode: (index % episodes) as u64,
                    reason,
                });
                f64::NAN
            }
        });
    }
}

/// Whether a whole request is at fault, not one of its evaluations.
fn is_refusal(error: &RolloutError) -> bool {
    matches!(
        error,
        RolloutError::Parameter(_)
            | RolloutError::Mismatch { .. }
            | RolloutError::NotSteered { .. }
    )
}

/// A request that this server cannot serve.
pub(crate) fn invalid(reason: String) -> Refusal {
    Refusal {
        kind: RefusalKind::Invalid,
        reason,
    }
}
