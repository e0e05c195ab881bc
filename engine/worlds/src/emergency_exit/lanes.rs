//! Emergency Exit in lanes: one episode per lane, its own grid in bytes, the networks of all lanes at once.
//!
//! Each lane has the index of an agent's cell; what lies around it is read lane by lane, since lanes are elsewhere on
//! their grids, and then computed with together. Agents that are out are moved to a cell behind the border where
//! nothing ever happens, so that no step asks whether they are still there.

use swarmwright_controllers::LaneController;
use swarmwright_lanes::{Int, Lanes, Mask};

use super::field::Field;
use super::grid::Grid;
use super::settings::{self, Settings, Update};
use super::{ACTUATORS, SENSORS};
use crate::ParameterError;
use crate::block::{Block, LaneWorld};

/// Two vectors: four would not leave enough of the nearest cache.
const MOST_LANES: usize = 32;
/// Added to dx and dy in `Terrain::to_exit`, so that both are positive: sides are far below 2^14.
const BIAS: i32 = 1 << 14;
/// dx = dy = 0: an exit, the only one below 0.
const EXIT: i32 = i32::MIN | BIAS << 16 | BIAS;
/// Up to here the grids of two vectors stay near the processor.
const FEW_CELLS: usize = 1 << 14;
/// More cells than this in all grids of a group of lanes, and memory rather than arithmetic sets the pace.
const MOST_CELLS: usize = 1 << 27;

/// An integer for each lane.
#[derive(Clone, Copy)]
#[repr(align(64))]
struct PerLane([i32; MOST_LANES]);

/// The episodes of a block. They differ in the field alone.
pub(crate) struct EmergencyExitLanes {
    settings: Settings,
    terrains: Vec<Terrain>,
    /// Index of each episode's terrain.
    of_episode: Vec<usize>,
    agents: usize,
    cells: usize,
    stride: usize,
    /// Cell behind the border where agents that are out are kept.
    nowhere: i32,
}

/// A field in cells, with a border of two rows above, one below, and one column on each side.
struct Terrain {
    /// By cell: dy and dx to the nearest exit, each with `BIAS` added, in 15 of 16 bits each, or `EXIT`.
    to_exit: Vec<i32>,
    /// By cell: distance to the nearest exit; 0 where agents that are out are kept.
    distance: Vec<f64>,
    /// By cell at the start: 1 where an agent could go.
    free: Vec<u8>,
    /// Cells of the agents at the start.
    places: Vec<i32>,
}

pub(crate) struct Room<L: Lanes> {
    /// By lane, then cell: 1 where an agent could go now.
    free: Vec<u8>,
    /// Index in `free` of each lane's cell to the left of its first one.
    bases: PerLane,
    /// By agent: its cell in each lane.
    places: Vec<PerLane>,
    /// By agent: `Terrain::to_exit` of its cell in each lane.
    ways: Vec<PerLane>,
    /// By agent, for a simultaneous step: the cells before and those it wants to go to.
    moves: Vec<(PerLane, PerLane)>,
    /// By agent: the lanes in which it is inside.
    inside: Vec<u64>,
    /// State of the agents' controllers, one after another.
    states: Vec<L>,
}

impl Terrain {
    fn new(field: &Field) -> Self {
        let grid = Grid::new(field);
        let stride = field.width as usize + 2;
        let cells = stride * (field.height as usize + 3) + 4;
        let mut terrain = Self {
            to_exit: vec![0; cells],
            distance: vec![0.0; cells],
            free: vec![0; cells],
            places: Vec::new(),
        };
        // One row more above than in the grid.
        let index = |cell| grid.index(cell) + stride;
        for y in 0..field.height {
            for x in 0..field.width {
                let [dx, dy] = grid.to_exit(grid.index([x, y])).map(i32::from);
                let way = (dy + BIAS) << 16 | (dx + BIAS);
                terrain.to_exit[index([x, y])] = if [dx, dy] == [0, 0] { EXIT } else { way };
                terrain.distance[index([x, y])] = grid.distance(grid.index([x, y]));
                terrain.free[index([x, y])] = 1;
            }
        }
        for blockade in &field.blockades {
            terrain.free[index(*blockade)] = 0;
        }
        for agent in &field.agents {
            terrain.free[index(*agent)] = 0;
            terrain.places.push(index(*agent) as i32);
        }
        terrain
    }
}

impl LaneWorld for EmergencyExitLanes {
    const MOST_VECTORS: usize = 2;
    type Room<L: Lanes> = Room<L>;

    fn new(block: &Block<'_>) -> Result<Option<Self>, ParameterError> {
        let Some(first) = (!block.seeds.is_empty()).then(|| block.parameters_of(0)) else {
            return Ok(None);
        };
        let settings = Settings::read(&first)?;
        let given = first.contains_key("field");
        let mut fields = Vec::new();
        for episode in 0..if given { 1 } else { block.seeds.len() } {
            fields.extend(
                settings::read_field(&block.parameters_of(episode), None)?.map(|(_, field)| field),
            );
        }
        let Some(field) = fields.first() else {
            return Ok(None);
        };
        let stride = field.width as usize + 2;
        let cells = stride * (field.height as usize + 3) + 4;
        // Rows below the last one are a case of their own, see `Field::rows`.
        if fields.iter().any(|field| field.rows != field.height)
            || cells * (MOST_LANES + fields.len()) > MOST_CELLS
        {
            return Ok(None);
        }
        Ok(Some(Self {
            settings,
            agents: field.agents.len(),
            cells,
            stride,
            nowhere: stride as i32 + 1,
            of_episode: (0..block.seeds.len())
                .map(|episode| if given { 0 } else { episode })
                .collect(),
            terrains: fields.iter().map(Terrain::new).collect(),
        }))
    }

    fn vectors(&self) -> usize {
        if self.cells <= FEW_CELLS { 2 } else { 1 }
    }

    #[inline(always)]
    fn room<L: Lanes>(&self, controllers: &LaneController<'_, L>) -> Room<L> {
        let simultaneous = self.settings.update == Update::Simultaneous;
        let mut bases = PerLane([0; MOST_LANES]);
        for (lane, base) in bases.0.iter_mut().enumerate() {
            *base = (lane * self.cells) as i32 - 1;
        }
        Room {
            bases,
            free: vec![0; self.cells * L::WIDTH],
            places: vec![PerLane([0; MOST_LANES]); self.agents],
            ways: vec![PerLane([0; MOST_LANES]); self.agents],
            moves: vec![
                (PerLane([0; MOST_LANES]), PerLane([0; MOST_LANES]));
                if simultaneous { self.agents } else { 0 }
            ],
            inside: vec![0; self.agents],
            states: vec![L::splat(0.0); self.agents * controllers.state_length()],
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
        let mut terrains = [&self.terrains[0]; MOST_LANES];
        for (terrain, episode) in terrains.iter_mut().zip(episodes) {
            *terrain = &self.terrains[self.of_episode[*episode]];
        }
        let all = u64::MAX >> (64 - L::WIDTH);
        room.start(self, &terrains, all);
        let mut finished = [self.settings.steps; MOST_LANES];
        let mut running = all;
        for step in 0..self.settings.steps {
            let inside = match self.settings.update {
                Update::Sequential => room.step_in_turn(self, &terrains, controllers),
                Update::Simultaneous => room.step_together(self, &terrains, controllers),
            };
            let ended = running & !inside;
            for (lane, finished) in finished.iter_mut().enumerate() {
                if ended >> lane & 1 == 1 {
                    *finished = step;
                }
            }
            running &= inside;
            if running == 0 {
                break;
            }
        }
        let steps = self.settings.steps;
        for (lane, fitness) in fitness.iter_mut().enumerate() {
            *fitness = f64::from(steps - finished[lane]) / f64::from(steps);
            for places in &room.places {
                *fitness -= terrains[lane].distance[places.0[lane] as usize];
            }
        }
    }
}

/// What the copies of an agent in all lanes see around them.
#[inline(always)]
fn sense<L: Lanes>(
    free: &[u8],
    bases: &PerLane,
    stride: usize,
    places: &PerLane,
    ways: &PerLane,
) -> [L; SENSORS] {
    // The cell to the left.
    let around = L::Int::load(&places.0).add(L::Int::load(&bases.0));
    let row = L::Int::splat(stride as i32);
    let (above, beside, below) = (
        around.sub(row).lookup_bytes(free),
        around.lookup_bytes(free),
        around.add(row).lookup_bytes(free),
    );
    let way = L::Int::load(&ways.0);
    [
        half::<L>(way, 0),
        half::<L>(way, 16),
        byte::<L>(above, 8),
        byte::<L>(above, 16),
        byte::<L>(beside, 16),
        byte::<L>(below, 16),
        byte::<L>(below, 8),
        byte::<L>(below, 0),
        byte::<L>(beside, 0),
        byte::<L>(above, 0),
    ]
}

/// 16 bits of each lane, without `BIAS`.
#[inline(always)]
fn half<L: Lanes>(way: L::Int, shift: i32) -> L {
    let half = way.shr(L::Int::splat(shift)).and(L::Int::splat(0x7FFF));
    L::from_int(half.sub(L::Int::splat(BIAS)))
}

/// A byte of each lane, 0 or 1.
#[inline(always)]
fn byte<L: Lanes>(row: L::Int, shift: i32) -> L {
    L::from_int(row.shr(L::Int::splat(shift)).and(L::Int::splat(1)))
}

/// `numbers[index]`
#[inline(always)]
fn get<T: Copy>(numbers: &[T], index: usize) -> T {
    debug_assert!(index < numbers.len());
    // SAFETY: see `four`: agents never leave their field, since the cells around it are never free.
    #[allow(unsafe_code)]
    unsafe {
        *numbers.get_unchecked(index)
    }
}

/// `numbers[index] = value`
#[inline(always)]
fn put<T>(numbers: &mut [T], index: usize, value: T) {
    debug_assert!(index < numbers.len());
    // SAFETY: as above.
    #[allow(unsafe_code)]
    unsafe {
        *numbers.get_unchecked_mut(index) = value;
    }
}

/// What to add to a cell's index to make the move of an agent; 0 where it is not inside.
#[inline(always)]
fn steps<L: Lanes>(actuators: [L; ACTUATORS], stride: i32, inside: u64) -> L::Int {
    let step = velocity(actuators[0], 1).add(velocity(actuators[1], stride));
    step.select(L::Int::splat(0), L::Mask::from_bits(inside))
}

/// `unit` forward, backward or not at all.
#[inline(always)]
fn velocity<L: Lanes>(actuator: L, unit: i32) -> L::Int {
    let forward = L::Int::splat(unit).select(L::Int::splat(0), L::splat(0.5).le(actuator));
    L::Int::splat(-unit).select(forward, actuator.lt(L::splat(-0.5)))
}

impl<L: Lanes> Room<L> {
    #[inline(always)]
    fn start(&mut self, world: &EmergencyExitLanes, terrains: &[&Terrain; MOST_LANES], all: u64) {
        for (lane, free) in self.free.chunks_exact_mut(world.cells).enumerate() {
            free.copy_from_slice(&terrains[lane].free);
        }
        for agent in 0..world.agents {
            for (lane, terrain) in terrains.iter().enumerate() {
                let place = terrain.places[agent];
                self.places[agent].0[lane] = place;
                self.ways[agent].0[lane] = terrain.to_exit[place as usize];
            }
        }
        self.inside.fill(all);
        self.states.fill(L::splat(0.0));
    }

    /// The cells to which all lanes' copies of an agent want to go.
    #[inline(always)]
    fn decide(
        &mut self,
        agent: usize,
        world: &EmergencyExitLanes,
        controllers: &mut LaneController<'_, L>,
    ) -> PerLane {
        let places = &self.places[agent];
        let sensors: [L; SENSORS] = sense(
            &self.free,
            &self.bases,
            world.stride,
            places,
            &self.ways[agent],
        );
        let mut actuators = [L::splat(0.0); ACTUATORS];
        let length = controllers.state_length();
        controllers.step(
            &mut self.states[agent * length..][..length],
            &sensors,
            &mut actuators,
        );
        let mut targets = PerLane([0; MOST_LANES]);
        let step: L::Int = steps(actuators, world.stride as i32, self.inside[agent]);
        L::Int::load(&places.0).add(step).store(&mut targets.0);
        targets
    }

    /// Takes those who stand on an exit out.
    #[inline(always)]
    fn leave(&mut self, agent: usize, world: &EmergencyExitLanes) {
        let ways = L::Int::load(&self.ways[agent].0);
        let mut out = ways.eq(L::Int::splat(EXIT)).bits();
        self.inside[agent] &= !out;
        while out != 0 {
            let lane = out.trailing_zeros() as usize;
            out &= out - 1;
            let place = &mut self.places[agent].0[lane];
            self.free[lane * world.cells + *place as usize] = 1;
            *place = world.nowhere;
            self.ways[agent].0[lane] = 0;
        }
    }

    /// One after another. Returns the lanes in which somebody is still inside.
    #[inline(always)]
    fn step_in_turn(
        &mut self,
        world: &EmergencyExitLanes,
        terrains: &[&Terrain; MOST_LANES],
        controllers: &mut LaneController<'_, L>,
    ) -> u64 {
        let mut any = 0;
        for agent in 0..world.agents {
            if self.inside[agent] == 0 {
                continue;
            }
            let targets = self.decide(agent, world, controllers);
            let (places, ways, free) = (
                &mut self.places[agent],
                &mut self.ways[agent],
                &mut self.free,
            );
            let mut ways_taken = 0;
            for (lane, terrain) in terrains.iter().enumerate().take(L::WIDTH) {
                let base = lane * world.cells;
                let (place, target) = (places.0[lane], targets.0[lane]);
                let moved = get(free, base + target as usize);
                // Without a branch: nobody foresees who is in whose way.
                let there = place ^ (place ^ target) & -i32::from(moved);
                // The cell that was left is free, the one entered is not. Who stays stays on a cell that is not.
                put(free, base + place as usize, moved);
                put(free, base + there as usize, 0);
                places.0[lane] = there;
                let way = get(&terrain.to_exit, there as usize);
                ways.0[lane] = way;
                ways_taken |= way;
            }
            // Few steps lead to an exit; the numbers just stored had better not be loaded as one vector at once.
            if ways_taken < 0 {
                self.leave(agent, world);
            }
            any |= self.inside[agent];
        }
        any
    }

    /// All sense, then all move: no cell that somebody stood on at the start of the step is free in it.
    #[inline(always)]
    fn step_together(
        &mut self,
        world: &EmergencyExitLanes,
        terrains: &[&Terrain; MOST_LANES],
        controllers: &mut LaneController<'_, L>,
    ) -> u64 {
        for agent in 0..world.agents {
            if self.inside[agent] != 0 {
                self.moves[agent] = (self.places[agent], self.decide(agent, world, controllers));
            }
        }
        for agent in 0..world.agents {
            if self.inside[agent] == 0 {
                continue;
            }
            let (places, (_, targets)) = (&mut self.places[agent], &self.moves[agent]);
            for lane in 0..L::WIDTH {
                let base = lane * world.cells;
                let target = targets.0[lane];
                if get(&self.free, base + target as usize) == 1 {
                    places.0[lane] = target;
                }
                put(&mut self.free, base + places.0[lane] as usize, 0);
            }
        }
        let mut any = 0;
        for agent in 0..world.agents {
            if self.inside[agent] == 0 {
                continue;
            }
            let (places, (before, _)) = (&self.places[agent], &self.moves[agent]);
            for (lane, terrain) in terrains.iter().enumerate().take(L::WIDTH) {
                let (left, there) = (before.0[lane], places.0[lane]);
                if left != there {
                    put(&mut self.free, lane * world.cells + left as usize, 1);
                }
                self.ways[agent].0[lane] = get(&terrain.to_exit, there as usize);
            }
            self.leave(agent, world);
            any |= self.inside[agent];
        }
        any
    }
}
