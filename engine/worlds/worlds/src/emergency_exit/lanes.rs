//! Emergency Exit in lanes: one episode per lane, its own grid in bits, the networks of all lanes at once.
//!
//! Lanes are elsewhere on their grids, so each reads its own four bytes of it: that is all it needs to know of the cells
//! around an agent, to sense and to move. Cells are changed only in lanes whose agent moves.
//! Agents that are out are put where nothing ever happens, so that no step asks whether they are still there.

mod exits;
mod prepared;
mod terrain;
mod workspace;

use std::sync::Arc;
use std::sync::atomic::AtomicBool;

use swarmwright_controllers::{Architecture, LaneControllers};
use swarmwright_lanes::Lanes;

use crate::ParameterError;
use crate::block::{Block, LaneWorld};
use prepared::Prepared;
use swarmwright_simulation::rollout::stopped;
use workspace::Workspace;

/// Two vectors: with four, the agents leave the nearest cache.
const MOST_LANES: usize = 2 * swarmwright_lanes::MOST_LANES_UNPAIRED;

/// The episodes of a block. They differ in the field alone.
pub(crate) struct EmergencyExitLanes(Arc<Prepared>);

/// Whether no group of a team has fewer sensors or actuators than the others.
fn senses_all(architecture: &Architecture) -> bool {
    let sizes = |of: &Architecture| (of.sensors(), of.actuators());
    architecture.team().is_none_or(|team| {
        let mut groups = team.groups.iter();
        groups.all(|group| sizes(&group.controller) == sizes(architecture))
    })
}

impl LaneWorld for EmergencyExitLanes {
    const VECTORS: usize = 2;
    type Workspace<L: Lanes> = Workspace<L>;

    fn new(block: &Block<'_>) -> Result<Option<Self>, ParameterError> {
        let prepared = Prepared::of(block)?;
        Ok(prepared
            .filter(|_| senses_all(block.architecture))
            .map(Self))
    }

    fn agents(&self) -> usize {
        self.0.agents
    }

    #[inline(always)]
    fn workspace<L: Lanes>(&self, controllers: &LaneControllers<'_, L>) -> Workspace<L> {
        Workspace::new(&self.0, controllers)
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
        let world = &*self.0;
        let mut terrains = [0; MOST_LANES];
        for (terrain, episode) in terrains.iter_mut().zip(episodes) {
            *terrain = world.terrain_of(*episode);
        }
        workspace.start(world, &terrains);
        let steps = world.settings.steps;
        workspace.finished = [steps; MOST_LANES];
        let mut running = u64::MAX >> (64 - L::WIDTH);
        for step in 0..steps {
            if stopped(stop) {
                break;
            }
            let inside = workspace.step(world, controllers);
            let ended = running & !inside;
            for (lane, finished) in workspace.finished.iter_mut().enumerate() {
                if ended >> lane & 1 == 1 {
                    *finished = step;
                }
            }
            running &= inside;
            if running == 0 {
                break;
            }
        }
        for (fitness, finished) in fitness.iter_mut().zip(workspace.finished) {
            *fitness = f64::from(steps - finished) / f64::from(steps);
        }
        workspace.subtract_distances(fitness);
    }

    #[inline(always)]
    fn metric<L: Lanes>(&self, workspace: &Workspace<L>, index: usize, values: &mut [f64]) {
        values.fill(0.0);
        match index {
            0 => workspace.count_out(values),
            1 => {
                for (value, finished) in values.iter_mut().zip(workspace.finished) {
                    *value = f64::from(finished);
                }
            }
            _ => {
                workspace.subtract_distances(values);
                for value in values {
                    *value = 0.0 - *value;
                }
            }
        }
    }
}
