//! Blocks of evaluations in this process: candidates x episodes, in lanes and threads.

use std::borrow::Borrow;
use std::ops::Range;
use std::sync::atomic::{AtomicBool, Ordering};

use rayon::prelude::*;
use swarmwright_controllers::{Architecture, Controller, ControllerError, LaneControllers};
use swarmwright_lanes::{IS_FOR_PORTABLE, Kernel, Lanes, Level, MOST_LANES, Pair, prefetch};

use crate::rollout::{check_groups, check_sizes, rollout_until, stopped};
use crate::{Description, ParameterError, Parameters, RolloutError, Simulation, measure};

/// Many controllers of one architecture, each to be run in the same episodes.
#[derive(Debug, Clone, Copy)]
pub struct Block<'a> {
    /// What all controllers have in common.
    pub architecture: &'a Architecture,
    /// (candidates, weights), row-major.
    pub genomes: &'a [f32],
    /// Parameters of the simulation; the seed in them is replaced by each of `seeds`.
    pub parameters: &'a Parameters,
    /// One seed per episode.
    pub seeds: &'a [u64],
    /// Metrics that are wanted beside the fitness, by their index in the simulation's description.
    pub metrics: &'a [usize],
    /// Once it is true, the results are not wanted any more: they come soon, and mean nothing.
    pub stop: Option<&'a AtomicBool>,
}

/// How a block is evaluated. The results do not depend on it.
#[derive(Debug, Clone, Copy)]
pub struct Means {
    /// Instruction set of the lanes; none for one episode at a time.
    pub level: Option<Level>,
    /// Threads; 0 for one per processor.
    pub threads: usize,
}

impl Default for Means {
    fn default() -> Self {
        Self {
            level: Some(Level::best()),
            threads: 0,
        }
    }
}

impl<'a> Block<'a> {
    /// Number of candidates.
    #[must_use]
    pub fn candidates(&self) -> usize {
        self.genomes.len() / self.architecture.weight_count()
    }

    /// Number of episodes in all.
    #[must_use]
    pub fn len(&self) -> usize {
        self.candidates() * self.seeds.len()
    }

    /// Whether there is nothing to do.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// Numbers that come out of an episode: the fitness, and the metrics that are wanted.
    #[must_use]
    pub const fn numbers(&self) -> usize {
        1 + self.metrics.len()
    }

    /// The weights of one candidate.
    #[must_use]
    pub fn genome(&self, candidate: usize) -> &'a [f32] {
        let length = self.architecture.weight_count();
        &self.genomes[candidate * length..][..length]
    }

    /// The first weight that is not a finite number.
    fn not_finite(&self) -> Option<RolloutError> {
        let position = self.genomes.iter().position(|weight| !weight.is_finite())?;
        let length = self.architecture.weight_count();
        let (candidate, index) = (position / length, position % length);
        let source = ControllerError::WeightValue { index };
        Some(RolloutError::Weights { candidate, source })
    }

    /// The parameters of one episode.
    #[must_use]
    pub fn parameters_of(&self, episode: usize) -> Parameters {
        let mut parameters = self.parameters.clone();
        parameters.insert("seed".to_owned(), self.seeds[episode].into());
        parameters
    }
}

/// A simulation whose episodes can be computed in lanes, made for the episodes of one block.
pub trait LaneWorld: Sync + Sized {
    /// Vectors of lanes side by side, at most: 1, 2 or 4.
    const VECTORS: usize;

    /// Whether the portable instruction set is of use, too; else episodes are computed one at a time there.
    const PORTABLE: bool = IS_FOR_PORTABLE;

    /// Memory for the state of as many episodes as there are lanes, used for one group of episodes after the other.
    type Workspace<L: Lanes>;

    /// Checks the parameters of every episode; `None` if lanes are not worthwhile or not possible.
    ///
    /// # Errors
    /// A parameter that the simulation refuses.
    fn new(block: &Block<'_>) -> Result<Option<Self>, ParameterError>;

    /// Vectors of lanes side by side for these episodes, at most [`VECTORS`](Self::VECTORS).
    fn vectors(&self) -> usize {
        Self::VECTORS
    }

    /// Number of agents, which controllers steer; the same in all episodes.
    fn agents(&self) -> usize;

    /// A workspace for lanes.
    fn workspace<L: Lanes>(&self, controllers: &LaneControllers<'_, L>) -> Self::Workspace<L>;

    /// Runs the given episode in each lane, until `stop`, and writes each lane's fitness.
    fn rollout<L: Lanes>(
        &self,
        workspace: &mut Self::Workspace<L>,
        controllers: &mut LaneControllers<'_, L>,
        episodes: &[usize],
        stop: Option<&AtomicBool>,
        fitness: &mut [f64],
    );

    /// Writes each lane's value of the metric with this index in the description, as it is after `rollout`.
    fn metric<L: Lanes>(&self, workspace: &Self::Workspace<L>, index: usize, values: &mut [f64]);
}

struct Part<'a, W> {
    world: &'a W,
    block: &'a Block<'a>,
    first: usize,
    /// For each episode its fitness and metrics.
    results: &'a mut [f64],
}

impl<W: LaneWorld> Kernel for Part<'_, W> {
    /// Whether all weights are finite numbers.
    type Output = bool;

    #[inline(always)]
    fn run<L: Lanes>(self) -> bool {
        // A constant, so that nothing is compiled for lanes that are not used.
        if const { W::PORTABLE || L::WIDTH > Level::Portable.width() } {
            side_by_side::<L, W>(self.world, self.block, self.first, self.results)
        } else {
            unreachable!("episodes of this simulation are not computed in portable lanes")
        }
    }
}

/// Evaluates episodes from `first` on, as many as fit into `results`: many vectors side by side while there are
/// episodes for them, then fewer. False as soon as a weight is not a finite number.
#[inline(always)]
fn side_by_side<L: Lanes, W: LaneWorld>(
    world: &W,
    block: &Block<'_>,
    mut first: usize,
    mut results: &mut [f64],
) -> bool {
    let numbers = block.numbers();
    for vectors in [4, 2, 1] {
        if vectors > world.vectors().max(1) {
            continue;
        }
        let (wide, episodes) = (vectors * L::WIDTH, results.len() / numbers);
        let rest = episodes % wide;
        // Half of the lanes empty takes as long as the same in fewer vectors.
        let now = if vectors == 1 || rest > wide / 2 {
            episodes
        } else {
            episodes - rest
        };
        let (these, others) = results.split_at_mut(now * numbers);
        let finite = match vectors {
            // Constants, so that nothing is compiled for vectors that are not used.
            4 if const { W::VECTORS >= 4 } => {
                groups::<Pair<Pair<L>>, W>(world, block, first, these)
            }
            2 if const { W::VECTORS >= 2 } => groups::<Pair<L>, W>(world, block, first, these),
            _ => groups::<L, W>(world, block, first, these),
        };
        if !finite {
            return false;
        }
        first += now;
        results = others;
    }
    true
}

/// Weights that are fetched before they are needed: 16 KB, so that those in use stay in the nearest cache.
const MOST_AHEAD: usize = 1 << 12;

/// Evaluates episodes from `first` on, as many as fit into `results`, a vector of lanes at a time; false as soon as a
/// weight is not a finite number.
#[inline(always)]
fn groups<L: Lanes, W: LaneWorld>(
    world: &W,
    block: &Block<'_>,
    first: usize,
    results: &mut [f64],
) -> bool {
    if results.is_empty() {
        return true;
    }
    let episodes_each = block.seeds.len();
    let mut controllers = LaneControllers::<L>::new(block.architecture, world.agents());
    let mut workspace = world.workspace::<L>(&controllers);
    let mut lanes = [0.0; MOST_LANES];
    let numbers = block.numbers();
    // Counted once: for a network of many layers this takes a while.
    let length = block.architecture.weight_count();
    for (group, results) in results.chunks_mut(L::WIDTH * numbers).enumerate() {
        if stopped(block.stop) {
            return true;
        }
        let count = results.len() / numbers;
        let first = first + group * L::WIDTH;
        let (mut candidate, mut episode) = (first / episodes_each, first % episodes_each);
        let last = (first + count - 1) / episodes_each;
        // They are about to be read anyway: a pass of its own over all genomes would take a third of an evaluation.
        if !finite(&block.genomes[candidate * length..(last + 1) * length]) {
            return false;
        }
        // Those of the next vectors arrive from memory while these episodes are computed.
        let next = &block.genomes[(last + 1) * length..];
        prefetch(&next[..next.len().min(L::WIDTH * length).min(MOST_AHEAD)]);
        let mut genomes: [&[f32]; MOST_LANES] = [&[]; MOST_LANES];
        let mut episodes = [0; MOST_LANES];
        for lane in 0..L::WIDTH {
            genomes[lane] = &block.genomes[candidate * length..][..length];
            episodes[lane] = episode;
            // Lanes without an episode of their own repeat the last one.
            if lane + 1 < count {
                episode += 1;
                if episode == episodes_each {
                    (candidate, episode) = (candidate + 1, 0);
                }
            }
        }
        controllers.load(&genomes[..L::WIDTH]);
        world.rollout(
            &mut workspace,
            &mut controllers,
            &episodes[..L::WIDTH],
            block.stop,
            &mut lanes[..L::WIDTH],
        );
        spread(&lanes[..count], results, numbers);
        for (index, metric) in block.metrics.iter().enumerate() {
            world.metric(&workspace, *metric, &mut lanes[..L::WIDTH]);
            spread(&lanes[..count], &mut results[1 + index..], numbers);
        }
    }
    true
}

/// Whether all are finite numbers; in vectors, as no number is a way out of the loop.
#[inline(always)]
fn finite(weights: &[f32]) -> bool {
    weights
        .iter()
        .fold(true, |all, weight| all & weight.is_finite())
}

/// Writes one number of each episode, `numbers` places apart.
#[inline(always)]
fn spread(values: &[f64], results: &mut [f64], numbers: usize) {
    for (value, result) in values.iter().zip(results.iter_mut().step_by(numbers)) {
        *result = *value;
    }
}

/// Episodes that one thread works on at a time, where vectors side by side have `wide` lanes.
fn part(episodes: usize, wide: usize, workers: usize) -> usize {
    if workers == 1 {
        // Whole vectors as long as there are, and one remainder.
        episodes
    } else if episodes <= workers * wide {
        // A share for each thread, in a time that hardly depends on how many lanes are used.
        episodes.div_ceil(workers)
    } else {
        // Several parts per thread, so that a thread that was held up does not hold up the others.
        episodes.div_ceil(workers * 4).next_multiple_of(wide)
    }
}

/// Runs `work` over parts of the results, in threads; each episode has `numbers` of them, and `wide` episodes are computed
/// side by side.
fn in_parts(
    results: &mut [f64],
    numbers: usize,
    wide: usize,
    threads: usize,
    work: impl Fn(Range<usize>, &mut [f64]) + Sync,
) {
    let workers = if threads == 0 {
        rayon::current_num_threads()
    } else {
        threads
    };
    let part = part(results.len() / numbers, wide, workers).max(1);
    let each = |(index, results): (usize, &mut [f64])| {
        let first = index * part;
        work(first..first + results.len() / numbers, results);
    };
    let chunk = part * numbers;
    if results.len() <= chunk {
        results.chunks_mut(chunk).enumerate().for_each(each);
    } else {
        results.par_chunks_mut(chunk).enumerate().for_each(each);
    }
}

/// Evaluates a block in lanes, or one episode at a time where lanes are not wanted or do not pay.
///
/// # Errors
/// Parameters that the simulation refuses, weights that are not finite numbers.
pub fn evaluate<W: LaneWorld>(
    block: &Block<'_>,
    means: Means,
    create: Create,
) -> Result<Vec<f64>, RolloutError> {
    let world = W::new(block)?;
    let level = means
        .level
        .filter(|level| W::PORTABLE || *level != Level::Portable);
    let world = world.filter(|world| fits_agents(block, world.agents(), create));
    if let (Some(level), Some(world)) = (level, &world) {
        let numbers = block.numbers();
        let mut results = vec![0.0; block.len() * numbers];
        let all_finite = AtomicBool::new(true);
        let work = |range: Range<usize>, results: &mut [f64]| {
            let part = Part {
                world,
                block,
                first: range.start,
                results,
            };
            if all_finite.load(Ordering::Relaxed) && !level.run(part) {
                all_finite.store(false, Ordering::Relaxed);
            }
        };
        let wide = level.width() * world.vectors();
        in_parts(&mut results, numbers, wide, means.threads, work);
        if !all_finite.into_inner()
            && let Some(error) = block.not_finite()
        {
            return Err(error);
        }
        return Ok(results);
    }
    one_by_one(block, means, create)
}

/// Whether every agent has a controller that was made for it; if not, an episode says what is wrong.
fn fits_agents(block: &Block<'_>, agents: usize, create: Create) -> bool {
    let Some(team) = block.architecture.team() else {
        return true;
    };
    if block.is_empty() || team.agents().is_some_and(|count| (count as usize) < agents) {
        return false;
    }
    let mut simulation = create();
    simulation.reset(&block.parameters_of(0)).is_ok()
        && check_groups("", team, &simulation.groups()).is_ok()
}

/// Evaluates a block in this thread with lanes of one's own, as measurements have them, a vector at a time; none where the
/// simulation does not compute these episodes in lanes. Teams must be made for its agents.
///
/// # Errors
/// As [`evaluate`].
pub fn evaluate_in<L: Lanes, W: LaneWorld>(
    block: &Block<'_>,
) -> Result<Option<Vec<f64>>, RolloutError> {
    let Some(world) = W::new(block)? else {
        return Ok(None);
    };
    let mut results = vec![0.0; block.len() * block.numbers()];
    if !groups::<L, W>(&world, block, 0, &mut results)
        && let Some(error) = block.not_finite()
    {
        return Err(error);
    }
    Ok(Some(results))
}

/// Makes a simulation at the start of an episode with default parameters.
pub type Create = fn() -> Box<dyn Simulation>;

/// Evaluates a block of controllers that fit the simulation.
pub type Evaluate = fn(&Block<'_>, Means, Create) -> Result<Vec<f64>, RolloutError>;

/// Evaluates a block with `evaluate`, or one episode at a time where its controllers do not steer, or are not computed here.
///
/// # Errors
/// Parameters that the simulation refuses, controllers that do not fit its `description`.
pub fn evaluate_fitting<D: Borrow<Description>>(
    block: &Block<'_>,
    means: Means,
    create: Create,
    evaluate: Evaluate,
    description: impl FnOnce() -> Result<D, ParameterError>,
) -> Result<Vec<f64>, RolloutError> {
    let architecture = block.architecture;
    if !architecture.steers() {
        return one_by_one(block, means, create);
    }
    check_sizes(
        description()?.borrow(),
        architecture.sensors(),
        architecture.actuators(),
    )?;
    if architecture.in_python().is_some() {
        return one_by_one(block, means, create);
    }
    evaluate(block, means, create)
}

/// Evaluates a block one episode at a time.
///
/// # Errors
/// Parameters that the simulation refuses, or controllers that do not fit it.
pub fn one_by_one(
    block: &Block<'_>,
    means: Means,
    create: Create,
) -> Result<Vec<f64>, RolloutError> {
    let parameters: Vec<Parameters> = (0..block.seeds.len())
        .map(|episode| block.parameters_of(episode))
        .collect();
    let numbers = block.numbers();
    let mut results = vec![0.0; block.len() * numbers];
    let failed = std::sync::Mutex::new(None::<(usize, RolloutError)>);
    let architecture = std::sync::Arc::new(block.architecture.clone());
    in_parts(&mut results, numbers, 1, means.threads, |range, results| {
        let mut simulation = create();
        for (pair, numbers) in range.zip(results.chunks_exact_mut(numbers)) {
            if stopped(block.stop) {
                return;
            }
            let (candidate, episode) = (pair / block.seeds.len(), pair % block.seeds.len());
            let result = Controller::with_weights(&architecture, block.genome(candidate).into())
                .map_err(|source| RolloutError::Weights { candidate, source })
                .and_then(|controller| {
                    rollout_until(
                        &mut *simulation,
                        &parameters[episode],
                        &controller,
                        block.stop,
                    )
                });
            match result {
                Ok(fitness) => {
                    numbers[0] = fitness;
                    measure(&*simulation, block.metrics, &mut numbers[1..]);
                }
                Err(error) => {
                    let mut first = failed
                        .lock()
                        .unwrap_or_else(std::sync::PoisonError::into_inner);
                    // The first in order, not in time: it is the same for any number of threads.
                    if first.as_ref().is_none_or(|(other, _)| pair < *other) {
                        *first = Some((pair, error));
                    }
                    return;
                }
            }
        }
    });
    failed
        .into_inner()
        .unwrap_or_else(std::sync::PoisonError::into_inner)
        .map_or(Ok(results), |(_, error)| Err(error))
}
