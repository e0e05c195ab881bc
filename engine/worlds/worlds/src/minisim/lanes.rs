//! Minisim in lanes: the operations of the module above, one episode per lane.

use std::sync::atomic::AtomicBool;

use swarmwright_controllers::LaneControllers;
use swarmwright_controllers::functions::lanes::{cos_pi, sin_pi};
use swarmwright_lanes::{Lanes, MOST_LANES, Mask};

use super::STEPS;
use super::settings::Settings;
use crate::ParameterError;
use crate::block::{Block, LaneWorld};
use swarmwright_simulation::rollout::stopped;

/// With more defenders every agent looks at all of them in vain; the stepper's grid is faster then.
const MOST_DEFENDERS: usize = 256;

/// Number of agents that move, and are checked by all defenders, while they are in the nearest cache.
const TOGETHER: usize = 32;

/// Numbers that an agent senses.
const SENSORS: usize = 4;

/// The episodes of a block. They differ in the positions at the start alone.
pub(crate) struct MinisimLanes {
    settings: Vec<Settings>,
    /// Whether the number of steps is requested.
    counts_steps: bool,
}

/// A coordinate pair per lane.
#[derive(Clone, Copy)]
struct Points<L> {
    x: L,
    y: L,
}

#[derive(Clone, Copy)]
struct Agent<L> {
    at: Points<L>,
    /// From the agent to the closest defender.
    to_defender: Points<L>,
}

/// The lanes in which an agent is free or has arrived; apart from the above, whose alignment it would fill up.
#[derive(Clone, Copy)]
struct Status {
    free: u64,
    arrived: u64,
}

/// From a defender to the closest free agent.
#[derive(Clone, Copy)]
struct Pursuit<L> {
    way: Points<L>,
    target: Points<L>,
    least: L,
}

pub(crate) struct Workspace<L> {
    agents: Vec<Agent<L>>,
    statuses: Vec<Status>,
    defenders: Vec<Points<L>>,
    /// By defender: the closest free agent of those looked at.
    pursuits: Vec<Pursuit<L>>,
    /// State of the agents' controllers, one after another.
    states: Vec<L>,
    /// Steps that were made in each lane, where they are counted.
    steps: [u32; MOST_LANES],
}

impl<L: Lanes> Points<L> {
    #[inline(always)]
    fn splat(point: [f32; 2]) -> Self {
        Self {
            x: L::splat(point[0]),
            y: L::splat(point[1]),
        }
    }

    /// Each lane's own point.
    #[inline(always)]
    fn gather(mut point: impl FnMut(usize) -> [f32; 2]) -> Self {
        let (mut x, mut y) = ([0.0; MOST_LANES], [0.0; MOST_LANES]);
        for lane in 0..L::WIDTH {
            [x[lane], y[lane]] = point(lane);
        }
        Self {
            x: L::load(&x),
            y: L::load(&y),
        }
    }

    #[inline(always)]
    fn minus(self, other: Self) -> Self {
        Self {
            x: self.x.sub(other.x),
            y: self.y.sub(other.y),
        }
    }

    #[inline(always)]
    fn square(self) -> L {
        self.x.mul(self.x).add(self.y.mul(self.y))
    }

    /// A step in a direction in half turns, limited to the map of this size.
    #[inline(always)]
    fn towards(self, heading: L, speed: L, [width, height]: [L; 2]) -> Self {
        let zero = L::splat(0.0);
        let x = self.x.add(speed.mul(cos_pi(heading)));
        let y = self.y.add(speed.mul(sin_pi(heading)));
        Self {
            x: x.at_least(zero).at_most(width),
            y: y.at_least(zero).at_most(height),
        }
    }

    #[inline(always)]
    fn select(self, other: Self, condition: L::Mask) -> Self {
        Self {
            x: self.x.select(other.x, condition),
            y: self.y.select(other.y, condition),
        }
    }
}

/// From an agent to the closest defender, the first on ties; 0, 0 without defenders.
#[inline(always)]
fn to_closest<L: Lanes>(agent: Points<L>, defenders: &[Points<L>]) -> (Points<L>, L) {
    let Some((first, others)) = defenders.split_first() else {
        return (Points::splat([0.0; 2]), L::splat(f32::INFINITY));
    };
    let mut best = first.minus(agent);
    let mut least = best.square();
    for defender in others {
        let way = defender.minus(agent);
        let q = way.square();
        let closer = q.lt(least);
        best = way.select(best, closer);
        least = q.select(least, closer);
    }
    (best, least)
}

impl LaneWorld for MinisimLanes {
    const VECTORS: usize = 4;
    type Workspace<L: Lanes> = Workspace<L>;

    fn new(block: &Block<'_>) -> Result<Option<Self>, ParameterError> {
        let settings = (0..block.seeds.len())
            .map(|episode| Settings::read(&block.parameters_of(episode)))
            .collect::<Result<Vec<_>, _>>()?;
        let few = settings
            .first()
            .is_some_and(|first| first.defenders.len() <= MOST_DEFENDERS && !first.steers_itself);
        Ok(few.then_some(Self {
            settings,
            counts_steps: block.metrics.contains(&STEPS),
        }))
    }

    fn agents(&self) -> usize {
        let settings = &self.settings[0];
        let defenders = if settings.controls_defenders {
            settings.defenders.len()
        } else {
            0
        };
        settings.agents.len() + defenders
    }

    #[inline(always)]
    fn workspace<L: Lanes>(&self, controllers: &LaneControllers<'_, L>) -> Workspace<L> {
        let agents = self.settings[0].agents.len();
        Workspace {
            agents: Vec::with_capacity(agents),
            statuses: Vec::with_capacity(agents),
            defenders: Vec::with_capacity(self.settings[0].defenders.len()),
            pursuits: Vec::with_capacity(self.settings[0].defenders.len()),
            states: vec![L::splat(0.0); controllers.state_length()],
            steps: [0; MOST_LANES],
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
        let settings = &self.settings[0];
        let all = u64::MAX >> (64 - L::WIDTH);
        let zero = L::splat(0.0);
        let (width, height) = (L::splat(settings.map[0]), L::splat(settings.map[1]));
        let goal = Points::<L>::splat(settings.goal);
        let speed = L::splat(settings.speed_agents);
        workspace.start(self, episodes, all);
        for _ in 0..settings.max_steps {
            if stopped(stop) {
                break;
            }
            let mut free = 0;
            let only = controllers
                .only()
                .filter(|group| group.sensors == SENSORS && !settings.controls_defenders);
            if let Some(group) = only {
                let controllers = &mut group.controllers;
                let state_length = controllers.state_length();
                let many = workspace.agents.len() > TOGETHER;
                if many {
                    workspace.start_pursuits();
                }
                for first in (0..workspace.agents.len()).step_by(TOGETHER) {
                    let last = (first + TOGETHER).min(workspace.agents.len());
                    for index in first..last {
                        let agent = &mut workspace.agents[index];
                        let free_here = workspace.statuses[index].free;
                        if free_here == 0 {
                            continue;
                        }
                        free |= free_here;
                        let to_goal = goal.minus(agent.at);
                        let sensors = [
                            to_goal.x.div(width),
                            to_goal.y.div(height),
                            agent.to_defender.x.div(width),
                            agent.to_defender.y.div(height),
                        ];
                        let mut heading = [zero];
                        let state = &mut workspace.states[index * state_length..][..state_length];
                        controllers.step(state, sensors, &mut heading);
                        let moved = agent.at.towards(heading[0], speed, [width, height]);
                        agent.at = moved.select(agent.at, L::Mask::from_bits(free_here));
                    }
                    if many {
                        workspace.pursue(first, last);
                    }
                }
            } else {
                L::apart(
                    #[inline(always)]
                    || free = workspace.step_groups(settings, controllers),
                );
            }
            if free == 0 {
                break;
            }
            if self.counts_steps {
                workspace.count_step(free);
            }
            if !settings.controls_defenders {
                workspace.move_defenders(L::splat(settings.speed_defenders), free);
            }
            workspace.judge(
                goal,
                L::splat(settings.goal_radius),
                L::splat(settings.capture_radius),
            );
        }
        workspace.fitness(goal, fitness);
    }

    #[inline(always)]
    fn metric<L: Lanes>(&self, workspace: &Workspace<L>, index: usize, values: &mut [f64]) {
        match index {
            0 => workspace.count(values, |status| status.arrived),
            1 => workspace.count(values, |status| !(status.arrived | status.free)),
            STEPS => {
                for (value, steps) in values.iter_mut().zip(workspace.steps) {
                    *value = f64::from(steps);
                }
            }
            _ => {
                workspace.fitness(Points::splat(self.settings[0].goal), values);
                for value in values {
                    *value = 0.0 - *value;
                }
            }
        }
    }
}

impl<L: Lanes> Workspace<L> {
    #[inline(always)]
    fn start(&mut self, world: &MinisimLanes, episodes: &[usize], all: u64) {
        let first = &world.settings[0];
        self.states.fill(L::splat(0.0));
        self.steps.fill(0);
        self.defenders.clear();
        for index in 0..first.defenders.len() {
            let at = Points::gather(|lane| world.settings[episodes[lane]].defenders[index]);
            self.defenders.push(at);
        }
        self.agents.clear();
        self.statuses.clear();
        for index in 0..first.agents.len() {
            let at = Points::gather(|lane| world.settings[episodes[lane]].agents[index]);
            let (to_defender, _) = to_closest(at, &self.defenders);
            self.agents.push(Agent { at, to_defender });
            self.statuses.push(Status {
                free: all,
                arrived: 0,
            });
        }
    }

    /// What a defender knows before it has looked at any agent.
    #[inline(always)]
    fn unaware(defender: Points<L>) -> Pursuit<L> {
        Pursuit {
            way: defender,
            target: defender,
            least: L::splat(f32::INFINITY),
        }
    }

    #[inline(always)]
    fn start_pursuits(&mut self) {
        self.pursuits.clear();
        for defender in &self.defenders {
            self.pursuits.push(Self::unaware(*defender));
        }
    }

    /// A defender looks at some of the agents.
    #[inline(always)]
    fn look(
        &self,
        defender: Points<L>,
        mut best: Pursuit<L>,
        first: usize,
        last: usize,
    ) -> Pursuit<L> {
        for (agent, status) in self.agents[first..last]
            .iter()
            .zip(&self.statuses[first..last])
        {
            if status.free == 0 {
                continue;
            }
            let offset = agent.at.minus(defender);
            let q = offset.square();
            let closer = q.lt(best.least).and(L::Mask::from_bits(status.free));
            best.way = offset.select(best.way, closer);
            best.target = agent.at.select(best.target, closer);
            best.least = q.select(best.least, closer);
        }
        best
    }

    /// Every defender looks at some of the agents.
    #[inline(always)]
    fn pursue(&mut self, first: usize, last: usize) {
        for index in 0..self.defenders.len() {
            self.pursuits[index] =
                self.look(self.defenders[index], self.pursuits[index], first, last);
        }
    }

    /// Moves the agents, and the defenders if they are steered, where not all have the same controllers, or not all sense the same.
    /// Returns the lanes in which an agent is free.
    #[inline(always)]
    fn step_groups(
        &mut self,
        settings: &Settings,
        controllers: &mut LaneControllers<'_, L>,
    ) -> u64 {
        let size = [L::splat(settings.map[0]), L::splat(settings.map[1])];
        let goal = Points::<L>::splat(settings.goal);
        let agents = self.agents.len();
        let defenders = if settings.controls_defenders {
            self.defenders.len()
        } else {
            0
        };
        let mut free = 0;
        // Defenders first: they look at the agents where these are at the start of the step.
        for index in (agents..agents + defenders).chain(0..agents) {
            let (at, offsets, speed, moving) = if let Some(defender) = index.checked_sub(agents) {
                let at = self.defenders[defender];
                let way = self.look(at, Self::unaware(at), 0, agents).way;
                let offsets = [way, goal.minus(at)];
                (at, offsets, settings.speed_defenders, u64::MAX)
            } else {
                let Agent { at, to_defender } = self.agents[index];
                let free = self.statuses[index].free;
                let offsets = [goal.minus(at), to_defender];
                (at, offsets, settings.speed_agents, free)
            };
            if moving == 0 {
                continue;
            }
            let [first, second] = offsets;
            let sensors = [
                first.x.div(size[0]),
                first.y.div(size[1]),
                second.x.div(size[0]),
                second.y.div(size[1]),
            ];
            let group = controllers.of(index);
            let state = &mut self.states[group.state_of(index)];
            let mut heading = [L::splat(0.0)];
            let sensors = &sensors[..group.sensors];
            group.controllers.step_slice(state, sensors, &mut heading);
            let moved = at.towards(heading[0], L::splat(speed), size);
            if let Some(defender) = index.checked_sub(agents) {
                self.defenders[defender] = moved;
            } else {
                free |= moving;
                self.agents[index].at = moved.select(at, L::Mask::from_bits(moving));
            }
        }
        if agents > TOGETHER {
            self.start_pursuits();
            self.pursue(0, agents);
        }
        free
    }

    /// Every defender goes towards the closest free agent; `free`: the lanes in which there is one.
    #[inline(always)]
    fn move_defenders(&mut self, speed: L, free: u64) {
        let agents = self.agents.len();
        for index in 0..self.defenders.len() {
            let defender = self.defenders[index];
            let pursuit = if agents <= TOGETHER {
                self.look(defender, Self::unaware(defender), 0, agents)
            } else {
                self.pursuits[index]
            };
            let d = pursuit.least.sqrt();
            let f = speed.div(d);
            let step = Points {
                x: defender.x.add(pursuit.way.x.mul(f)),
                y: defender.y.add(pursuit.way.y.mul(f)),
            };
            let moved = pursuit.target.select(step, d.le(speed));
            self.defenders[index] = moved.select(defender, L::Mask::from_bits(free));
        }
    }

    /// Updates which agents have arrived and which are caught.
    #[inline(always)]
    fn judge(&mut self, goal: Points<L>, goal_radius: L, capture_radius: L) {
        for (agent, status) in self.agents.iter_mut().zip(&mut self.statuses) {
            if status.free == 0 {
                continue;
            }
            let arrived = goal.minus(agent.at).square().sqrt().le(goal_radius).bits() & status.free;
            let (to_defender, q) = to_closest(agent.at, &self.defenders);
            let caught = q.sqrt().le(capture_radius).bits();
            agent.to_defender = to_defender;
            status.arrived |= arrived;
            status.free &= !(arrived | caught);
        }
    }

    /// A step was made in these lanes.
    #[inline(always)]
    fn count_step(&mut self, lanes: u64) {
        for (lane, steps) in self.steps.iter_mut().enumerate() {
            *steps += u32::from(lanes >> lane & 1 == 1);
        }
    }

    /// In each lane, the agents of which a status tells the lanes.
    #[inline(always)]
    fn count(&self, values: &mut [f64], lanes: impl Fn(&Status) -> u64) {
        values.fill(0.0);
        for status in &self.statuses {
            for (lane, value) in values.iter_mut().enumerate() {
                *value += f64::from(u8::from(lanes(status) >> lane & 1 == 1));
            }
        }
    }

    #[inline(always)]
    fn fitness(&self, goal: Points<L>, fitness: &mut [f64]) {
        fitness.fill(0.0);
        let mut distances = [0.0; MOST_LANES];
        for (agent, status) in self.agents.iter().zip(&self.statuses) {
            goal.minus(agent.at).square().sqrt().store(&mut distances);
            for (lane, (sum, distance)) in fitness.iter_mut().zip(distances).enumerate() {
                if status.arrived >> lane & 1 == 0 {
                    *sum += f64::from(distance);
                }
            }
        }
        #[expect(clippy::cast_precision_loss, reason = "at most 100,000 agents")]
        let agents = self.agents.len() as f64;
        for sum in fitness {
            *sum = 0.0 - *sum / agents;
        }
    }
}
