//! Jobs: requests for offloaded evaluation, computed on any thread.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

use serde_json::Value;
use swarmwright_controllers::{Architecture, Controller};
use swarmwright_protocol::{Failure, Refusal, RefusalKind, bytes_of};
use swarmwright_worlds::{
    Block, Description, Failure as Cause, Means, Parameters, RolloutError, Simulation, measure,
    rollout_until,
};

use crate::genomes::Genomes;
use crate::guard::{all_finite, guarded};
use crate::progress::Progress;

/// Number of candidates in the first part; later parts are sized so that the abort flag is checked within these bounds.
const FIRST_PART: usize = 256;
const SHORT: Duration = Duration::from_millis(10);
const LONG: Duration = Duration::from_millis(50);

/// Data that consecutive requests usually share.
#[derive(Debug)]
pub(crate) struct Setup {
    /// Index of the simulation among those that the server offers.
    pub simulation: usize,
    /// Specification of the controllers, as received.
    pub controller: Value,
    pub architecture: Architecture,
    pub parameters: Parameters,
    /// Names of the requested metrics.
    pub metrics: Vec<String>,
    /// Their indices in the simulation's description.
    pub wanted: Vec<usize>,
}

impl Setup {
    /// Returns the approximate number of bytes held.
    pub fn bytes(&self) -> usize {
        let controller = self.controller.as_object().map_or(0, bytes_of);
        controller + bytes_of(&self.parameters)
    }
}

/// A valid request.
#[derive(Debug)]
pub(crate) struct Request {
    pub number: u64,
    pub reply: String,
    pub setup: Arc<Setup>,
    pub genomes: Genomes,
    pub seeds: Vec<u64>,
    /// Bytes of its setup, unless an earlier request shares it.
    pub held: usize,
    /// When the tool gives the work to another server.
    pub expires: Option<Instant>,
}

impl Request {
    /// Returns the number of candidates.
    pub fn candidates(&self) -> usize {
        self.genomes
            .candidates(self.setup.architecture.weight_count())
    }

    /// Returns the number of bytes held.
    pub fn size(&self) -> usize {
        self.genomes.bytes() + self.seeds.len() * 8 + self.held
    }
}

/// A request that is being computed, with its simulation. Pass the result of [`run`](Self::run) to
/// [`Machine::finished`](crate::Machine::finished).
pub struct Job {
    pub(crate) request: Request,
    pub(crate) simulation: Box<dyn Simulation>,
    pub(crate) abort: Arc<AtomicBool>,
}

/// A request that has been computed.
pub struct Done {
    pub(crate) request: Request,
    pub(crate) simulation: Box<dyn Simulation>,
    pub(crate) result: Result<Evaluation, Refusal>,
    pub(crate) seconds: f64,
}

impl Done {
    /// Sets the duration, for simulated time in tests with many servers.
    #[must_use]
    pub fn took(self, time: Duration) -> Self {
        Self {
            seconds: time.as_secs_f64(),
            ..self
        }
    }
}

/// Fitness of candidates x episodes, row-major; NaN for the evaluations in `failed`.
#[derive(Debug, Default)]
pub(crate) struct Evaluation {
    pub fitness: Vec<f64>,
    /// Requested metrics, each in the layout of the fitness.
    pub metrics: Vec<Vec<f64>>,
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
    /// Returns the number of episodes to compute.
    #[must_use]
    pub fn episodes(&self) -> usize {
        self.request.candidates() * self.request.seeds.len()
    }

    /// Computes the request. The fitness does not depend on `means`.
    #[must_use]
    pub fn run(self, means: Means) -> Done {
        self.run_watched(means, None)
    }

    /// Like [`run`](Self::run), and reports the progress.
    pub(crate) fn run_watched(mut self, means: Means, progress: Option<&Progress>) -> Done {
        let start = Instant::now();
        let scope = self.simulation.scope();
        let mut result = Ok(Evaluation::default());
        scope(&mut || {
            result = evaluate(
                &mut *self.simulation,
                &self.request,
                means,
                &self.abort,
                progress,
            );
        });
        if let Some(progress) = progress {
            progress.idle();
        }
        Done {
            request: self.request,
            simulation: self.simulation,
            result,
            seconds: start.elapsed().as_secs_f64(),
        }
    }
}

/// Evaluates the block in parts, until it is done or aborted.
fn evaluate(
    simulation: &mut dyn Simulation,
    request: &Request,
    means: Means,
    abort: &AtomicBool,
    progress: Option<&Progress>,
) -> Result<Evaluation, Refusal> {
    let setup = &*request.setup;
    let weights = setup.architecture.weight_count();
    let mut evaluation = Evaluation {
        metrics: vec![Vec::new(); setup.metrics.len()],
        ..Evaluation::default()
    };
    let all = request.candidates();
    let mut buffer = Vec::new();
    // Fewer candidates would take as long.
    let least = simulation
        .lanes()
        .div_ceil(request.seeds.len().max(1))
        .max(1);
    let mut part = FIRST_PART.max(least);
    let mut first = 0;
    while first < all && !abort.load(Ordering::Relaxed) {
        let start = Instant::now();
        let candidates = part.min(all - first);
        let genomes = request.genomes.of(
            first..first + candidates,
            weights,
            means.threads,
            &mut buffer,
        );
        let block = Block {
            architecture: &setup.architecture,
            genomes,
            parameters: &setup.parameters,
            seeds: &request.seeds,
            metrics: &setup.wanted,
            stop: Some(abort),
        };
        let block = Part {
            block: &block,
            names: &setup.metrics,
            first,
            request: request.number,
            progress,
        };
        evaluate_part(simulation, &block, means, abort, &mut evaluation)?;
        first += candidates;
        let elapsed = start.elapsed();
        if elapsed < SHORT {
            part *= 2;
        } else if elapsed > LONG {
            part = (part / 2).max(least);
        }
    }
    Ok(evaluation)
}

/// Consecutive candidates of a request.
struct Part<'a> {
    block: &'a Block<'a>,
    /// Names of the metrics.
    names: &'a [String],
    /// Index of the first candidate.
    first: usize,
    /// Number of the request.
    request: u64,
    progress: Option<&'a Progress>,
}

fn evaluate_part(
    simulation: &mut dyn Simulation,
    part: &Part<'_>,
    means: Means,
    abort: &AtomicBool,
    evaluation: &mut Evaluation,
) -> Result<(), Refusal> {
    let numbers = part.block.numbers();
    if let Some(progress) = part.progress {
        progress.at(part.request, part.first, part.block.candidates(), None);
    }
    match guarded(|| simulation.evaluate(part.block, means)) {
        Ok(Some(Ok(results))) if results.len() == part.block.len() * numbers => {
            if numbers == 1 && results.iter().all(|fitness| fitness.is_finite()) {
                evaluation.fitness.extend(results);
                if let Some(progress) = part.progress {
                    progress.ended(part.block.len());
                }
                return Ok(());
            }
            for (index, results) in results.chunks_exact(numbers).enumerate() {
                let results = all_finite(results, part.names);
                if results.is_err() && part.block.architecture.in_python().is_some() {
                    // Evaluate the failed one alone to find the reason.
                    let episodes = part.block.seeds.len();
                    let architecture = Arc::new(part.block.architecture.clone());
                    let controller = part.controller(&architecture, index / episodes)?;
                    let alone = (&controller, &part.block.parameters_of(index % episodes));
                    evaluate_alone(simulation, part, index, alone, abort, evaluation)?;
                } else {
                    evaluation.push(part, index, results);
                }
            }
            if let Some(progress) = part.progress {
                progress.ended(part.block.len());
            }
            Ok(())
        }
        Ok(Some(Err(error))) if is_refusal(&error) => Err(invalid(error.to_string())),
        // The simulation does not evaluate blocks, or an evaluation failed and is found by running them one by one.
        _ => one_by_one(simulation, part, abort, evaluation),
    }
}

fn one_by_one(
    simulation: &mut dyn Simulation,
    part: &Part<'_>,
    abort: &AtomicBool,
    evaluation: &mut Evaluation,
) -> Result<(), Refusal> {
    let block = part.block;
    let episodes = block.seeds.len();
    let parameters: Vec<Parameters> = (0..episodes)
        .map(|episode| block.parameters_of(episode))
        .collect();
    let architecture = Arc::new(block.architecture.clone());
    for candidate in 0..block.candidates() {
        let controller = part.controller(&architecture, candidate)?;
        for (episode, parameters) in parameters.iter().enumerate() {
            if abort.load(Ordering::Relaxed) {
                return Ok(());
            }
            let index = candidate * episodes + episode;
            let alone = (&controller, parameters);
            evaluate_alone(simulation, part, index, alone, abort, evaluation)?;
            if let Some(progress) = part.progress {
                progress.ended(1);
            }
        }
    }
    Ok(())
}

/// Runs one evaluation of a part with its controller and its parameters.
fn evaluate_alone(
    simulation: &mut dyn Simulation,
    part: &Part<'_>,
    index: usize,
    (controller, parameters): (&Controller, &Parameters),
    abort: &AtomicBool,
    evaluation: &mut Evaluation,
) -> Result<(), Refusal> {
    let block = part.block;
    let episodes = block.seeds.len();
    let (candidate, episode) = (index / episodes, index % episodes);
    if let Some(progress) = part.progress {
        progress.at(part.request, part.first + candidate, 1, Some(episode));
    }
    let mut results = vec![0.0; block.numbers()];
    let run = || {
        results[0] = rollout_until(&mut *simulation, parameters, controller, Some(abort))?;
        measure(&*simulation, block.metrics, &mut results[1..]);
        Ok(())
    };
    let result = match guarded(run) {
        Ok(Ok(())) => all_finite(&results, part.names),
        Ok(Err(error)) if is_refusal(&error) => {
            return Err(invalid(error.to_string()));
        }
        Ok(Err(error)) => Err(error.to_string().into()),
        Err(cause) => Err(cause),
    };
    evaluation.push(part, index, result);
    Ok(())
}

impl Part<'_> {
    /// Returns the controller of a candidate.
    fn controller(
        &self,
        architecture: &Arc<Architecture>,
        candidate: usize,
    ) -> Result<Controller, Refusal> {
        let genome = self.block.genome(candidate).into();
        Controller::with_weights(architecture, genome).map_err(|error| {
            invalid(format!(
                "genomes: candidate {}: {error}",
                self.first + candidate
            ))
        })
    }
}

impl Evaluation {
    /// Adds a result; `index` is that of the evaluation within the part.
    fn push(&mut self, part: &Part<'_>, index: usize, result: Result<&[f64], Cause>) {
        let number = |column: usize| result.as_ref().map_or(f64::NAN, |results| results[column]);
        self.fitness.push(number(0));
        for (column, values) in self.metrics.iter_mut().enumerate() {
            values.push(number(1 + column));
        }
        if let Err(cause) = result {
            let episodes = part.block.seeds.len();
            let candidate = part.first + index / episodes;
            let episode = index % episodes;
            add_failure(&mut self.failed, candidate as u64, episode as u64, cause);
        }
    }
}

/// Largest number of stack traces in a message.
const STACKS: usize = 16;

/// Adds a failure to a message. Its stack trace is omitted if an earlier failure with the same reason has one, since
/// many candidates often fail in the same line.
pub(crate) fn add_failure(failed: &mut Vec<Failure>, candidate: u64, episode: u64, cause: Cause) {
    let is_news = |_: &String| {
        let others = failed.iter().filter(|other| other.stack.is_some());
        let reasons: Vec<&String> = others.map(|other| &other.reason).take(STACKS).collect();
        reasons.len() < STACKS && !reasons.contains(&&cause.reason)
    };
    let stack = cause.stack.filter(is_news);
    failed.push(Failure {
        candidate,
        episode,
        reason: cause.reason,
        stack,
    });
}

/// Returns whether an error concerns the whole request instead of a single evaluation.
fn is_refusal(error: &RolloutError) -> bool {
    matches!(
        error,
        RolloutError::Parameter(_)
            | RolloutError::Mismatch { .. }
            | RolloutError::Groups { .. }
            | RolloutError::NotSteered { .. }
    )
}

/// Returns the indices of the metrics with these names.
///
/// # Errors
/// Fails if the simulation does not have a metric, or if a name is repeated.
pub(crate) fn metrics_wanted(
    description: &Description,
    names: &[String],
) -> Result<Vec<usize>, Refusal> {
    let is_repeated = |(index, name): &(usize, &String)| names[..*index].contains(name);
    if let Some((_, name)) = names.iter().enumerate().find(is_repeated) {
        return Err(invalid(format!("metrics: {name:?} is named twice")));
    }
    let indices = description.metrics_named(names);
    indices.map_err(|error| invalid(error.to_string()))
}

/// Builds a refusal of a request that this server cannot serve.
pub(crate) fn invalid(reason: String) -> Refusal {
    Refusal {
        kind: RefusalKind::Invalid,
        reason,
    }
}
