//! A caller's simulation as the wrapper knows simulations.

use std::cell::Cell;
use std::sync::Arc;

use swarmwright_worlds::{
    Block, Description, Means, ParameterError, ParameterReader, Parameters, RolloutError, Scene,
    Simulation, fail,
};
use swarmwright_wrapper::scenes::is_sent;

use crate::callbacks::{Object, Table};
use crate::error::Trouble;
use crate::parallel::{self, WorkerGroup};
use crate::parameters::ParameterHandle;

/// Agents have numbers below this where a simulation names no limit: each that acts costs memory up to its number.
const MOST_AGENTS: u32 = 1 << 24;

pub(crate) struct Foreign {
    object: Object,
    acting: Vec<u32>,
    done: bool,
    /// Milliseconds for which to show the last picture.
    milliseconds: Cell<u32>,
    /// Why it could not be shown: the next step says so, for a picture cannot fail.
    not_shown: Cell<Option<Trouble>>,
    workers: WorkerGroup,
    /// Steps done.
    steps: u32,
}

impl Foreign {
    /// Makes a simulation.
    ///
    /// # Errors
    /// The caller's function reported an error.
    pub(crate) fn new(table: &Arc<Table>) -> Result<Self, Trouble> {
        Ok(Self {
            object: Object::create(table)?,
            acting: Vec::new(),
            done: true,
            milliseconds: Cell::new(250),
            not_shown: Cell::new(None),
            workers: WorkerGroup::default(),
            steps: 0,
        })
    }

    fn table(&self) -> &Arc<Table> {
        self.object.table()
    }

    /// What the simulation looks like.
    fn sent(&self) -> Option<Scene> {
        let (scene, milliseconds) = self
            .object
            .scene()
            .unwrap_or_else(|trouble| give_up(trouble))?;
        self.milliseconds.set(milliseconds);
        Some(Scene {
            step: self.steps,
            ..scene
        })
    }

    /// Asks who acts next.
    fn proceed(&mut self) -> Result<(), Trouble> {
        self.object.acting(&mut self.acting)?;
        check_agents(&self.acting, self.table().description.max_agents)?;
        self.done = match self.object.done()? {
            Some(done) => done,
            None => self.acting.is_empty(),
        };
        if self.done {
            self.acting.clear();
        }
        Ok(())
    }

    /// What the episode cannot go on with ends it.
    fn or_fail<T>(&mut self, result: Result<T, Trouble>) -> T {
        result.unwrap_or_else(|trouble| {
            self.acting.clear();
            self.done = true;
            give_up(trouble)
        })
    }
}

/// Whether the agents that act can be served.
pub(crate) fn check_agents(agents: &[u32], most: Option<u32>) -> Result<(), Trouble> {
    if let Some(pair) = agents.windows(2).find(|pair| pair[0] >= pair[1]) {
        return Err(Trouble::Failed(format!(
            "the acting agents must be in ascending order, but {} comes before {}",
            pair[0], pair[1]
        )));
    }
    let limit = most.unwrap_or(MOST_AGENTS);
    match agents.last() {
        Some(last) if *last >= limit => Err(Trouble::Failed(format!(
            "agent {last} acts, but there are at most {limit} agents, numbered from 0"
        ))),
        _ => Ok(()),
    }
}

/// Ends the episode with the reason.
fn give_up(trouble: Trouble) -> ! {
    fail(match trouble {
        Trouble::Invalid(text) | Trouble::Failed(text) => text,
        Trouble::Parameter(error) => error.to_string(),
    })
}

/// The seed among the parameters of an episode; 0 if there is none.
///
/// # Errors
/// It is not a whole number of 64 bits.
pub(crate) fn seed(parameters: &Parameters) -> Result<u64, ParameterError> {
    Ok(ParameterReader::new(parameters).seed("seed")?.unwrap_or(0))
}

impl Simulation for Foreign {
    fn description(&self) -> Description {
        self.table().description.clone()
    }

    fn reset(&mut self, parameters: &Parameters) -> Result<(), ParameterError> {
        let seed = seed(parameters)?;
        self.not_shown.set(None);
        self.steps = 0;
        let handle = ParameterHandle::new(parameters);
        match self.object.reset(&handle, seed) {
            Err(Trouble::Parameter(error)) => return Err(error),
            other => self.or_fail(other),
        }
        let result = self.proceed();
        self.or_fail(result);
        Ok(())
    }

    fn acting(&self) -> &[u32] {
        &self.acting
    }

    fn done(&self) -> bool {
        self.done
    }

    fn sense(&self, agent: u32, sensors: &mut [f32]) {
        if let Err(trouble) = self.object.sense(agent, sensors) {
            give_up(trouble);
        }
    }

    fn step(&mut self, actuators: &[f32]) {
        self.steps = self.steps.saturating_add(1);
        let shown = self.not_shown.take().map_or(Ok(()), Err);
        let result = shown
            .and_then(|()| self.object.step(actuators))
            .and_then(|()| self.proceed());
        self.or_fail(result);
    }

    fn fitness(&self) -> f64 {
        self.object
            .fitness()
            .unwrap_or_else(|trouble| give_up(trouble))
    }

    fn metrics(&self) -> Vec<f64> {
        self.object
            .metrics()
            .unwrap_or_else(|trouble| give_up(trouble))
    }

    fn duplicate(&self) -> Option<Box<dyn Simulation>> {
        if self.table().only_one {
            return None;
        }
        match Self::new(self.table()) {
            Ok(another) => Some(Box::new(another)),
            Err(trouble) => give_up(trouble),
        }
    }

    fn evaluate(
        &mut self,
        block: &Block<'_>,
        means: Means,
    ) -> Option<Result<Vec<f64>, RolloutError>> {
        let threads = parallel::threads(means, block);
        if threads < 2 || self.table().only_one {
            return None;
        }
        let table = Arc::clone(self.table());
        self.workers.evaluate(&table, block, threads).map(Ok)
    }

    fn has_scenes(&self) -> bool {
        self.object.has_scenes()
    }

    /// What is sent to a tool; otherwise the simulation shows itself, wherever it likes, and what comes back only says that
    /// it did.
    fn scene(&self) -> Option<Scene> {
        if is_sent() {
            return self.sent();
        }
        match self.object.show() {
            Ok(Some(milliseconds)) if milliseconds > 0 => self.milliseconds.set(milliseconds),
            Ok(_) => return None,
            Err(trouble) => {
                self.not_shown.set(Some(trouble));
                return None;
            }
        }
        Some(Scene::default())
    }

    fn step_size(&self) -> u64 {
        u64::from(self.milliseconds.get())
    }
}
