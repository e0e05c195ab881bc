//! Walks of several episodes that one simulation steps together.

use swarmwright_worlds::{Description, ParameterError, Parameters, Simulation, Together, measure};

use crate::Walk;

/// Walks that are stepped together; one that fails takes all with it.
#[derive(Default)]
pub struct JointWalks {
    alone: Walk,
    many: Vec<Walk>,
    results: Vec<Vec<f64>>,
    wanted: Vec<usize>,
}

impl JointWalks {
    fn look(&mut self) {
        let result = |walk: &Walk| {
            let mut values = vec![walk.fitness(); 1 + self.wanted.len()];
            measure(walk, &self.wanted, &mut values[1..]);
            values
        };
        self.results = self.many.iter().map(result).collect();
    }
}

impl Simulation for JointWalks {
    fn description(&self) -> Description {
        self.alone.description()
    }

    fn reset(&mut self, parameters: &Parameters) -> Result<(), ParameterError> {
        self.alone.reset(parameters)
    }

    fn acting(&self) -> &[u32] {
        Simulation::acting(&self.alone)
    }

    fn sense(&self, agent: u32, sensors: &mut [f32]) {
        Simulation::sense(&self.alone, agent, sensors);
    }

    fn step(&mut self, actuators: &[f32]) {
        Simulation::step(&mut self.alone, actuators);
    }

    fn fitness(&self) -> f64 {
        self.alone.fitness()
    }

    fn metrics(&self) -> Vec<f64> {
        self.alone.metrics()
    }

    fn duplicate(&self) -> Option<Box<dyn Simulation>> {
        Some(Box::new(Self::default()))
    }

    fn lanes(&self) -> usize {
        100
    }

    fn together(&mut self) -> Option<&mut dyn Together> {
        Some(self)
    }
}

impl Together for JointWalks {
    fn start(
        &mut self,
        parameters: &Parameters,
        seeds: &[u64],
        metrics: &[usize],
    ) -> Result<(), ParameterError> {
        self.many = vec![Walk::default(); seeds.len()];
        self.wanted = metrics.to_vec();
        let mut parameters = parameters.clone();
        for (walk, seed) in self.many.iter_mut().zip(seeds) {
            parameters.insert("seed".to_owned(), (*seed).into());
            walk.reset(&parameters)?;
        }
        self.look();
        Ok(())
    }

    fn acting(&self, episode: usize) -> &[u32] {
        Simulation::acting(&self.many[episode])
    }

    fn done(&self, episode: usize) -> bool {
        self.many[episode].done()
    }

    fn sense(&self, episode: usize, agent: u32, sensors: &mut [f32]) {
        Simulation::sense(&self.many[episode], agent, sensors);
    }

    fn step(&mut self, actuators: &[f32]) {
        let mut rest = actuators;
        for walk in &mut self.many {
            let own;
            (own, rest) = rest.split_at(Simulation::acting(walk).len());
            if !own.is_empty() {
                Simulation::step(walk, own);
            }
        }
        assert!(rest.is_empty(), "{} rows too many", rest.len());
        self.look();
    }

    fn results(&self, episode: usize) -> &[f64] {
        &self.results[episode]
    }
}
