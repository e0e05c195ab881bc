//! The state of as many episodes as there are lanes, and a step of all of them.

use swarmwright_controllers::{LaneControllers, LaneGroup};
use swarmwright_lanes::{Int, Lanes, Mask};

use super::super::ACTUATORS;
use super::super::settings::Update;
use super::MOST_LANES;
use super::exits::{columns_and_rows, numbers, of_step};
use super::prepared::Prepared;
use super::terrain::{AROUND, NOWHERE, OWN, Terrain};

pub(crate) struct Workspace<L: Lanes> {
    /// By lane, then stack: the cells that are not free now.
    taken: Vec<u8>,
    /// By lane: index in `taken` of the stack before its first one.
    stacks: L::Int,
    /// By lane: index in `Prepared::numbers` of its terrain's first place.
    terrains: L::Int,
    /// By lane: index in `Prepared::exits` of its terrain's first one.
    first_exits: L::Int,
    /// By agent: its place in each lane.
    places: Vec<L::Int>,
    /// By agent: the way to the nearest exit in each lane, see `exits`.
    ways: Vec<L::Int>,
    /// By agent: the number of that exit.
    exits: Vec<L::Int>,
    /// By agent: the lanes in which it is inside.
    inside: Vec<u64>,
    /// By lane: the step during which the last agent got out, else the number of steps.
    pub(super) finished: [u32; MOST_LANES],
    /// State of the agents' controllers, one after another.
    states: Vec<L>,
    /// By agent, for a simultaneous step: what it wants to do.
    wishes: Vec<Move<L>>,
}

/// The surroundings of an agent in each lane.
#[derive(Clone, Copy)]
struct Window<L: Lanes> {
    /// Index of the first of its stacks.
    stack: L::Int,
    /// Which cell of the stack the agent is in.
    row: L::Int,
    /// The cells that are not free, as if it were the uppermost one.
    taken: L::Int,
}

/// What an agent does in each lane.
#[derive(Clone, Copy)]
struct Move<L: Lanes> {
    /// What to add to its place: 8 for each column, 1 for each row.
    step: L::Int,
    /// The bit in `Window::taken` of the cell where it wants to go.
    target: L::Int,
}

impl<L: Lanes> Window<L> {
    /// Whether the cell of a bit is free.
    #[inline(always)]
    fn is_free(self, cell: L::Int) -> L::Mask {
        self.taken.and(cell).eq(L::Int::splat(0))
    }
}

impl<L: Lanes> Move<L> {
    #[inline(always)]
    fn new(actuators: [L; ACTUATORS]) -> Self {
        let step = velocity(actuators[0], 8).add(velocity(actuators[1], 1));
        Self {
            step,
            target: L::Int::splat(1).shl(step.add(L::Int::splat(OWN))),
        }
    }
}

/// `unit` forward, backward or not at all; not at all for NaN, which counts as 0.
#[inline(always)]
fn velocity<L: Lanes>(actuator: L, unit: i32) -> L::Int {
    let forward = L::Int::splat(unit).select(L::Int::splat(0), L::splat(0.5).le(actuator));
    L::Int::splat(-unit).select(forward, actuator.lt(L::splat(-0.5)))
}

/// Where an agent starts on the terrain of each lane: place, way, number of the exit.
#[inline(always)]
fn starts<L: Lanes>(all: &[Terrain], terrains: &[usize; MOST_LANES], agent: usize) -> [L::Int; 3] {
    if let [terrain] = all {
        return terrain.agents[agent].map(L::Int::splat);
    }
    let mut columns = [[0; MOST_LANES]; 3];
    for (lane, terrain) in terrains.iter().enumerate().take(L::WIDTH) {
        for (column, value) in columns.iter_mut().zip(all[*terrain].agents[agent]) {
            column[lane] = value;
        }
    }
    columns.map(|column| L::Int::load(&column))
}

impl<L: Lanes> Workspace<L> {
    #[inline(always)]
    pub(super) fn new(world: &Prepared, controllers: &LaneControllers<'_, L>) -> Self {
        let nothing = Move {
            step: L::Int::splat(0),
            target: L::Int::splat(0),
        };
        let simultaneous = world.settings.update == Update::Simultaneous;
        let mut stacks = [0; MOST_LANES];
        for (lane, stack) in stacks.iter_mut().enumerate() {
            *stack = (lane * world.layout.stacks) as i32 - 1;
        }
        Self {
            taken: vec![0; world.layout.stacks * L::WIDTH],
            stacks: L::Int::load(&stacks),
            terrains: L::Int::splat(0),
            first_exits: L::Int::splat(0),
            places: vec![L::Int::splat(0); world.agents],
            ways: vec![L::Int::splat(0); world.agents],
            exits: vec![L::Int::splat(0); world.agents],
            inside: vec![0; world.agents],
            finished: [0; MOST_LANES],
            states: vec![L::splat(0.0); controllers.state_length()],
            wishes: vec![nothing; if simultaneous { world.agents } else { 0 }],
        }
    }

    /// Puts the agents where the terrains of the lanes say; `terrains`: the index of each lane's one.
    #[inline(always)]
    pub(super) fn start(&mut self, world: &Prepared, terrains: &[usize; MOST_LANES]) {
        for (lane, occupied) in self.taken.chunks_exact_mut(world.layout.stacks).enumerate() {
            occupied.copy_from_slice(&world.terrains[terrains[lane]].taken);
        }
        self.terrains = L::Int::load(&terrains.map(|terrain| (terrain * world.places()) as i32));
        self.first_exits = L::Int::load(&terrains.map(|terrain| world.first_exits[terrain]));
        for agent in 0..world.agents {
            let [position, way, exit] = starts::<L>(&world.terrains, terrains, agent);
            self.places[agent] = position;
            self.ways[agent] = way;
            self.exits[agent] = exit;
        }
        self.inside.fill(u64::MAX >> (64 - L::WIDTH));
        self.states.fill(L::splat(0.0));
    }

    /// The lanes in which an agent is inside.
    #[inline(always)]
    pub(super) fn step(
        &mut self,
        world: &Prepared,
        controllers: &mut LaneControllers<'_, L>,
    ) -> u64 {
        match world.settings.update {
            Update::Sequential => self.step_in_turn(world, controllers),
            Update::Simultaneous => self.step_together(world, controllers),
        }
    }

    /// One after another.
    #[inline(always)]
    fn step_in_turn(&mut self, world: &Prepared, controllers: &mut LaneControllers<'_, L>) -> u64 {
        let mut any = 0;
        for group in controllers.groups_mut() {
            for agent in group.agents.clone() {
                if self.inside[agent] == 0 {
                    continue;
                }
                let window = self.look(agent);
                let wish = self.decide(agent, window, group);
                let moved = window.is_free(wish.target);
                let bits = moved.bits();
                if bits != 0 {
                    let cells = wish.target.or(L::Int::splat(1 << OWN));
                    self.flip(world, window, cells, bits);
                    self.go(agent, world, wish.step, moved);
                }
                any |= self.leave(agent, world);
            }
        }
        any
    }

    /// All sense, then all move: no cell that an agent was on at the start of the step is free in it.
    #[inline(always)]
    fn step_together(&mut self, world: &Prepared, controllers: &mut LaneControllers<'_, L>) -> u64 {
        for group in controllers.groups_mut() {
            for agent in group.agents.clone() {
                if self.inside[agent] != 0 {
                    self.wishes[agent] = self.decide(agent, self.look(agent), group);
                }
            }
        }
        // Cells are entered but not left.
        for agent in 0..world.agents {
            if self.inside[agent] == 0 {
                continue;
            }
            let wish = &mut self.wishes[agent];
            let target = wish.target;
            let window = self.look(agent);
            let moved = window.is_free(target);
            self.wishes[agent].target = L::Int::splat(1 << OWN).select(L::Int::splat(0), moved);
            self.flip(world, window, target, moved.bits());
        }
        // Now they are left.
        let mut any = 0;
        for agent in 0..world.agents {
            if self.inside[agent] == 0 {
                continue;
            }
            let wish = self.wishes[agent];
            let moved = wish.target.eq(L::Int::splat(1 << OWN));
            self.flip(world, self.look(agent), wish.target, moved.bits());
            self.go(agent, world, wish.step, moved);
            any |= self.leave(agent, world);
        }
        any
    }

    /// What lies around an agent.
    #[inline(always)]
    fn look(&self, agent: usize) -> Window<L> {
        let position = self.places[agent];
        let stack = position.shr(L::Int::splat(3)).add(self.stacks);
        let row = position.and(L::Int::splat(7));
        Window {
            stack,
            row,
            taken: stack.lookup_bytes(&self.taken).shr(row),
        }
    }

    /// What an agent wants to do.
    #[inline(always)]
    fn decide(&mut self, agent: usize, window: Window<L>, group: &mut LaneGroup<'_, L>) -> Move<L> {
        let numbers = numbers(self.ways[agent]);
        let mut actuators = [L::splat(0.0); ACTUATORS];
        let state = &mut self.states[group.state_of(agent)];
        let bits = (window.taken, AROUND);
        group
            .controllers
            .step_with_bits(state, numbers, bits, &mut actuators);
        Move::new(actuators)
    }

    /// Changes cells of a window in some lanes, from free to not free or back.
    #[inline(always)]
    fn flip(&mut self, world: &Prepared, window: Window<L>, cells: L::Int, lanes: u64) {
        let (mut stacks, mut flipped) = ([0; MOST_LANES], [0; MOST_LANES]);
        window.stack.store(&mut stacks);
        cells.shl(window.row).store(&mut flipped);
        let mut rest = lanes;
        // Few agents move, since most are blocked by others.
        while rest != 0 {
            let lane = rest.trailing_zeros() as usize;
            rest &= rest - 1;
            let (stack, cells) = (stacks[lane] as usize, flipped[lane] as u32);
            world.layout.flip(&mut self.taken, stack, cells);
        }
    }

    /// The agent is where its step leads to, in the lanes where it moved.
    #[inline(always)]
    fn go(&mut self, agent: usize, world: &Prepared, step: L::Int, moved: L::Mask) {
        let position = self.places[agent];
        let target = position.add(step);
        let target = target
            .add(target.lookup_eight(&world.corrections))
            .select(position, moved);
        self.places[agent] = target;
        let mut way = self.ways[agent].sub(of_step(step).select(L::Int::splat(0), moved));
        // Only where it moved: elsewhere the table need not be read.
        let exit = self.exits[agent];
        let nearest = target.add(self.terrains);
        let nearest = world.numbers.lookup_where(nearest, exit, moved);
        if moved.and_not(nearest.eq(exit)).any() {
            let exits = |numbers: L::Int| numbers.add(self.first_exits).lookup(&world.exits);
            way = way.add(exits(nearest)).sub(exits(exit));
            self.exits[agent] = nearest;
        }
        self.ways[agent] = way;
    }

    /// Takes those who stand on an exit out. Returns the lanes in which the agent is still inside.
    #[inline(always)]
    fn leave(&mut self, agent: usize, world: &Prepared) -> u64 {
        let on_exit = self.ways[agent].eq(L::Int::splat(0));
        let out = on_exit.bits() & self.inside[agent];
        if out != 0 {
            self.inside[agent] &= !out;
            self.flip(world, self.look(agent), L::Int::splat(1 << OWN), out);
            self.places[agent] = L::Int::splat(NOWHERE).select(self.places[agent], on_exit);
        }
        self.inside[agent]
    }

    /// Adds to each lane the number of its agents that are out.
    #[inline(always)]
    pub(super) fn count_out(&self, values: &mut [f64]) {
        for inside in &self.inside {
            for (lane, value) in values.iter_mut().enumerate() {
                *value += f64::from(u8::from(inside >> lane & 1 == 0));
            }
        }
    }

    /// The sum of all agents' distances to the nearest exit is taken off what `fitness` holds for each lane.
    #[inline(always)]
    pub(super) fn subtract_distances(&self, fitness: &mut [f64]) {
        for ways in &self.ways {
            let mut lanes = [0; MOST_LANES];
            ways.store(&mut lanes);
            for (fitness, way) in fitness.iter_mut().zip(lanes) {
                let [dx, dy] = columns_and_rows(way);
                *fitness -= f64::from(dx * dx + dy * dy).sqrt();
            }
        }
    }
}
