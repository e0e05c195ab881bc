//! Minisim in lanes: the operations of the module above, one episode per lane.

use swarmwright_controllers::LaneController;
use swarmwright_controllers::functions::lanes::{cos_pi, sin_pi};
use swarmwright_lanes::{Lanes, Mask};

use super::settings::Settings;
use crate::ParameterError;
use crate::block::{Block, LaneWorld, MOST_LANES};

/// With more defenders every agent looks at all of them in vain; the stepper's grid is faster then.
const MOST_DEFENDERS: usize = 256;

/// The episodes of a block. They differ in the positions at the start alone.
pub(crate) struct MinisimLanes(Vec<Settings>);

/// A coordinate pair per lane.
#[derive(Clone, Copy)]
struct Points<L> {
    x: L,
    y: L,
}

struct Agent<L> {
    at: Points<L>,
    /// From the agent to the closest defender.
    to_defender: Points<L>,
    free: u64,
    arrived: u64,
}

pub(crate) struct Room<L> {
    agents: Vec<Agent<L>>,
    defenders: Vec<Points<L>>,
    /// State of the agents' controllers, one after another.
    states: Vec<L>,
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
    const FOUR: bool = true;
    type Room<L: Lanes> = Room<L>;

    fn new(block: &Block<'_>) -> Result<Option<Self>, ParameterError> {
        let settings = (0..block.seeds.len())
            .map(|episode| Settings::read(&block.parameters_of(episode)))
            .collect::<Result<Vec<_>, _>>()?;
        let few = settings
            .first()
            .is_some_and(|first| first.defenders.len() <= MOST_DEFENDERS);
        Ok(few.then_some(Self(settings)))
    }

    #[inline(always)]
    fn room<L: Lanes>(&self, controllers: &LaneController<'_, L>) -> Room<L> {
        let agents = self.0[0].agents.len();
        Room {
            agents: Vec::with_capacity(agents),
            defenders: Vec::with_capacity(self.0[0].defenders.len()),
            states: vec![L::splat(0.0); agents * controllers.state_length()],
        }
    }

    #[inline(always)]
    fn rollout<L: Lanes>(
        &self,
        room: &mut Room<L>,
        controllers: &mut LaneController<'_, L>,
        episodes: &[usize],
        fitness: &mut [f64],
    ) {
        let settings = &self.0[0];
        let all = u64::MAX >> (64 - L::WIDTH);
        let zero = L::splat(0.0);
        let (width, height) = (L::splat(settings.map[0]), L::splat(settings.map[1]));
        let goal = Points::<L>::splat(settings.goal);
        let speed = L::splat(settings.speed_agents);
        let state_length = controllers.state_length();
        room.start(self, episodes, all);
        for _ in 0..settings.max_steps {
            let mut free_before = 0;
            for (index, agent) in room.agents.iter_mut().enumerate() {
                if agent.free == 0 {
                    continue;
                }
                free_before |= agent.free;
                let to_goal = goal.minus(agent.at);
                let sensors = [
                    to_goal.x.div(width),
                    to_goal.y.div(height),
                    agent.to_defender.x.div(width),
                    agent.to_defender.y.div(height),
                ];
                let mut heading = [zero];
                let state = &mut room.states[index * state_length..][..state_length];
                controllers.step(state, &sensors, &mut heading);
                let x = agent.at.x.add(speed.mul(cos_pi(heading[0])));
                let y = agent.at.y.add(speed.mul(sin_pi(heading[0])));
                let moved = Points {
                    x: x.at_least(zero).at_most(width),
                    y: y.at_least(zero).at_most(height),
                };
                agent.at = moved.select(agent.at, L::Mask::from_bits(agent.free));
            }
            if free_before == 0 {
                break;
            }
            room.move_defenders(L::splat(settings.speed_defenders));
            room.judge(
                goal,
                L::splat(settings.goal_radius),
                L::splat(settings.capture_radius),
            );
        }
        room.fitness(goal, fitness);
    }
}

impl<L: Lanes> Room<L> {
    #[inline(always)]
    fn start(&mut self, world: &MinisimLanes, episodes: &[usize], all: u64) {
        let first = &world.0[0];
        self.states.fill(L::splat(0.0));
        self.defenders.clear();
        for index in 0..first.defenders.len() {
            let at = Points::gather(|lane| world.0[episodes[lane]].defenders[index]);
            self.defenders.push(at);
        }
        self.agents.clear();
        for index in 0..first.agents.len() {
            let at = Points::gather(|lane| world.0[episodes[lane]].agents[index]);
            let (to_defender, _) = to_closest(at, &self.defenders);
            self.agents.push(Agent {
                at,
                to_defender,
                free: all,
                arrived: 0,
            });
        }
    }

    /// Every defender goes towards the closest free agent.
    #[inline(always)]
    fn move_defenders(&mut self, speed: L) {
        for defender in &mut self.defenders {
            let (mut way, mut target, mut least) = (*defender, *defender, L::splat(f32::INFINITY));
            let mut any = 0;
            for agent in &self.agents {
                if agent.free == 0 {
                    continue;
                }
                any |= agent.free;
                let there = agent.at.minus(*defender);
                let q = there.square();
                let closer = q.lt(least).and(L::Mask::from_bits(agent.free));
                way = there.select(way, closer);
                target = agent.at.select(target, closer);
                least = q.select(least, closer);
            }
            let d = least.sqrt();
            let f = speed.div(d);
            let step = Points {
                x: defender.x.add(way.x.mul(f)),
                y: defender.y.add(way.y.mul(f)),
            };
            let moved = target.select(step, d.le(speed));
            *defender = moved.select(*defender, L::Mask::from_bits(any));
        }
    }

    /// Who has arrived, who is caught.
    #[inline(always)]
    fn judge(&mut self, goal: Points<L>, goal_radius: L, capture_radius: L) {
        for agent in &mut self.agents {
            if agent.free == 0 {
                continue;
            }
            let arrived = goal.minus(agent.at).square().sqrt().le(goal_radius).bits() & agent.free;
            let (to_defender, q) = to_closest(agent.at, &self.defenders);
            let caught = q.sqrt().le(capture_radius).bits();
            agent.to_defender = to_defender;
            agent.arrived |= arrived;
            agent.free &= !(arrived | caught);
        }
    }

    #[inline(always)]
    fn fitness(&self, goal: Points<L>, fitness: &mut [f64]) {
        fitness.fill(0.0);
        let mut distances = [0.0; MOST_LANES];
        for agent in &self.agents {
            goal.minus(agent.at).square().sqrt().store(&mut distances);
            for (lane, (sum, distance)) in fitness.iter_mut().zip(distances).enumerate() {
                if agent.arrived >> lane & 1 == 0 {
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
