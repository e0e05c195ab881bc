//! Episodes of a batch that one simulation steps together, and their separate continuation if its code fails.

use swarmwright_worlds::{Failure as Cause, ParameterError, Parameters, Simulation, Together};

use crate::guard::guarded;

/// A simulation, the initial values of its episodes, and all actuators since.
pub(crate) struct Group {
    simulation: Box<dyn Simulation>,
    parameters: Parameters,
    seeds: Vec<u64>,
    /// Concatenated rows of actuators for each episode, used to repeat the episode alone.
    log: Vec<Vec<f32>>,
    steps: usize,
    actuators: usize,
}

/// An episode that continues alone, or the reason why it does not.
pub(crate) type Alone = Result<Box<dyn Simulation>, Cause>;

impl Group {
    pub fn new(
        simulation: Box<dyn Simulation>,
        parameters: Parameters,
        seeds: Vec<u64>,
        actuators: usize,
    ) -> Self {
        Self {
            simulation,
            parameters,
            log: vec![Vec::new(); seeds.len()],
            seeds,
            steps: 0,
            actuators,
        }
    }

    /// Resets all episodes. Returns whether the parameters are accepted. `metrics`: indices of the requested metrics.
    ///
    /// # Errors
    /// Returns the failure of the simulation's code; then call [`apart`](Self::apart).
    pub fn start(&mut self, metrics: &[usize]) -> Result<Result<(), ParameterError>, Cause> {
        guarded(|| match self.simulation.together() {
            Some(episodes) => episodes.start(&self.parameters, &self.seeds, metrics),
            None => Ok(()),
        })
    }

    /// Returns the episodes.
    pub fn episodes(&mut self) -> Option<&mut dyn Together> {
        self.simulation.together()
    }

    /// Returns whether some episode has not ended, and no agent acts in any running episode.
    pub fn goes_on(&mut self, running: &[bool]) -> bool {
        let Some(episodes) = self.simulation.together() else {
            return false;
        };
        let mut going = (0..running.len()).filter(|&i| running[i] && !episodes.done(i));
        let first = going.next();
        first
            .into_iter()
            .chain(going)
            .all(|index| episodes.acting(index).is_empty())
            && first.is_some()
    }

    /// Steps all episodes. `actuators` has one row for each acting agent of each running episode.
    ///
    /// # Errors
    /// Returns the failure of the simulation's code; then call [`apart`](Self::apart).
    pub fn step(&mut self, actuators: &[f32], running: &[bool]) -> Result<(), Cause> {
        self.steps += 1;
        let Some(episodes) = self.simulation.together() else {
            return Ok(());
        };
        let mut all = Vec::with_capacity(actuators.len());
        let mut rest = actuators;
        for (index, (log, runs)) in self.log.iter_mut().zip(running).enumerate() {
            let count = episodes.acting(index).len() * self.actuators;
            if *runs {
                let own;
                (own, rest) = rest.split_at(count.min(rest.len()));
                log.extend_from_slice(own);
                all.extend_from_slice(own);
            } else {
                // The episode has ended or failed, so it is never repeated.
                log.clear();
                all.resize(all.len() + count, 0.0);
            }
        }
        guarded(|| episodes.step(&all))
    }

    /// Repeats the running episodes, each in its own simulation, up to the step at which the code failed: the faulty
    /// one fails again, the others continue. Also returns the group's simulation.
    pub fn apart(self, running: &[bool]) -> (Box<dyn Simulation>, Vec<Option<Alone>>) {
        let episodes = running
            .iter()
            .enumerate()
            .map(|(index, runs)| runs.then(|| self.alone(index)))
            .collect();
        (self.simulation, episodes)
    }

    fn alone(&self, index: usize) -> Alone {
        let mut parameters = self.parameters.clone();
        parameters.insert("seed".to_owned(), self.seeds[index].into());
        guarded(|| {
            let mut simulation = self
                .simulation
                .duplicate()
                .ok_or_else(|| Cause::from("there can be no other simulation".to_owned()))?;
            simulation
                .reset(&parameters)
                .map_err(|error| Cause::from(error.to_string()))?;
            let mut rest = &self.log[index][..];
            for _ in 0..self.steps {
                if simulation.done() {
                    break;
                }
                let count = (simulation.acting().len() * self.actuators).min(rest.len());
                let own;
                (own, rest) = rest.split_at(count);
                simulation.step(own);
            }
            Ok(simulation)
        })
        .and_then(|alone| alone)
    }

    /// Returns the simulation, for the next batch.
    pub fn into_simulation(self) -> Box<dyn Simulation> {
        self.simulation
    }
}
