//! The arena in lanes: the operations of `Arena`, one episode per lane.

use std::sync::atomic::AtomicBool;

use swarmwright_arena::{MOST_IN_LANES, Settings, Starts, Swarm, Tally};
use swarmwright_controllers::LaneControllers;
use swarmwright_lanes::Lanes;
use swarmwright_simulation::block::{self, Block, Create, LaneWorld};
use swarmwright_simulation::rollout::stopped;
use swarmwright_simulation::{Means, ParameterError, RolloutError};

/// Maximum number of vectors of lanes that are computed side by side.
pub const VECTORS: usize = ArenaLanes::VECTORS;

/// Evaluates a block of controllers that fit the robots.
///
/// # Errors
/// Returns an error if parameters are invalid or weights are not finite.
pub fn evaluate(block: &Block<'_>, means: Means, create: Create) -> Result<Vec<f64>, RolloutError> {
    block::evaluate::<ArenaLanes>(block, means, create)
}

/// Evaluates a block in this thread with a custom lane type, for example one that counts operations. Returns `None` if
/// the episodes cannot be computed in lanes.
///
/// # Errors
/// See [`evaluate`].
pub fn evaluate_in<L: Lanes>(block: &Block<'_>) -> Result<Option<Vec<f64>>, RolloutError> {
    block::evaluate_in::<L, ArenaLanes>(block)
}

/// Number of robots above which `FEW_EPISODES` applies.
const MANY_ROBOTS: usize = 256;
/// Fewer episodes than this run faster one at a time with many robots, because unused lanes cost as much as used ones.
const FEW_EPISODES: usize = 3;
/// Maximum number of robots for four vectors side by side; the state of more robots does not fit into the nearest
/// caches.
const MOST_IN_FOUR: usize = 64;

/// Returns the number of vectors side by side for episodes with this many robots.
pub(crate) fn vectors(robots: usize) -> usize {
    if robots > MOST_IN_FOUR {
        2
    } else {
        ArenaLanes::VECTORS
    }
}

/// The episodes of a block. They differ only in the seed.
pub(crate) struct ArenaLanes {
    settings: Settings,
    /// Seed and start positions of each episode.
    starts: Vec<(u64, Starts)>,
    /// The requested metrics that are measured only at the end.
    wanted: Vec<usize>,
}

pub(crate) struct Workspace<L: Lanes> {
    swarm: Swarm<L>,
    tallies: Vec<Tally<L>>,
    /// States of the robots' controllers, one after another.
    states: Vec<L>,
    /// (robots, actuators), row-major; those that a robot's controller does not have are 0.
    actuators: Vec<L>,
}

impl LaneWorld for ArenaLanes {
    // A single vector stalls, because each contact needs the velocities that the previous contact left.
    const VECTORS: usize = 4;
    // Four portable lanes are slower than one episode at a time.
    const PORTABLE: bool = false;
    type Workspace<L: Lanes> = Workspace<L>;

    fn new(block: &Block<'_>) -> Result<Option<Self>, ParameterError> {
        let mut settings = Settings::read(block.parameters)?;
        let robots = settings.team.len();
        let few = robots > MANY_ROBOTS && block.len() < FEW_EPISODES;
        if few || robots > MOST_IN_LANES {
            return Ok(None);
        }
        let mut starts = Vec::with_capacity(block.seeds.len());
        for seed in block.seeds {
            settings.seed = *seed;
            starts.push((*seed, settings.starts()?));
        }
        let counted = settings.mission.counted;
        let indices = block.metrics.iter().copied();
        Ok(Some(Self {
            wanted: indices.filter(|index| *index >= counted).collect(),
            settings,
            starts,
        }))
    }

    fn vectors(&self) -> usize {
        vectors(self.settings.team.len())
    }

    fn agents(&self) -> usize {
        self.settings.team.len()
    }

    fn workspace<L: Lanes>(&self, controllers: &LaneControllers<'_, L>) -> Workspace<L> {
        let robots = self.settings.team.len();
        Workspace {
            swarm: Swarm::new(&self.settings.team, &self.settings.mission.place.objects),
            tallies: Vec::new(),
            states: vec![L::splat(0.0); controllers.state_length()],
            actuators: vec![L::splat(0.0); robots * self.settings.team.actuators()],
        }
    }

    #[inline(always)]
    fn rollout<L: Lanes>(
        &self,
        workspace: &mut Workspace<L>,
        controllers: &mut LaneControllers<'_, L>,
        episodes: &[usize],
        stop: Option<&AtomicBool>,
        fitness: &mut [f64],
    ) {
        let Settings { mission, team, .. } = &self.settings;
        let layout = &mission.place;
        workspace.states.fill(L::splat(0.0));
        workspace.tallies.clear();
        workspace
            .tallies
            .extend(mission.metrics.iter().map(|_| Tally::default()));
        let starts = |lane: usize| &self.starts[episodes[lane]];
        L::apart(
            #[inline(always)]
            || {
                workspace.swarm.start(
                    team,
                    layout,
                    (&self.settings.failures, &mission.rules),
                    |lane| starts(lane).0,
                    |lane, index| starts(lane).1.robots[index],
                    |lane, index| starts(lane).1.objects[index],
                );
            },
        );
        loop {
            let tick = workspace.swarm.tick;
            let last = tick >= self.settings.ticks;
            let (bodies, colors) = (&workspace.swarm.bodies, &workspace.swarm.colors);
            let metrics: &[usize] = if last { &self.wanted } else { &[] };
            L::apart(
                #[inline(always)]
                || {
                    for index in (0..mission.counted).chain(metrics.iter().copied()) {
                        let metric = &mission.metrics[index].1;
                        workspace.tallies[index].update(
                            metric,
                            bodies,
                            layout,
                            colors,
                            (tick, last),
                        );
                    }
                },
            );
            if last || stopped(stop) {
                break;
            }
            let (sensors, actuators) = (team.sensors(), team.actuators());
            for group in controllers.groups_mut() {
                for index in group.agents.clone() {
                    let state = group.state_of(index);
                    group.controllers.step_slice(
                        &mut workspace.states[state],
                        &workspace.swarm.senses.outputs[index * sensors..][..group.sensors],
                        &mut workspace.actuators[index * actuators..][..group.actuators],
                    );
                }
            }
            workspace.swarm.step(team, layout, &workspace.actuators);
        }
        for (lane, fitness) in fitness.iter_mut().enumerate() {
            *fitness = mission.fitness(|metric| workspace.tallies[metric].values[lane]);
        }
    }

    #[inline(always)]
    fn metric<L: Lanes>(&self, workspace: &Workspace<L>, index: usize, values: &mut [f64]) {
        for (lane, value) in values.iter_mut().enumerate() {
            let measured = |metric: usize| workspace.tallies[metric].values[lane];
            *value = self.settings.mission.value(index, measured);
        }
    }
}
