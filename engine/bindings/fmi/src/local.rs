//! A built-in simulation in this process.

use swarmwright_worlds::{self as worlds, Parameters, Simulation};
use swarmwright_wrapper::guarded;

use crate::model::Model;
use crate::world::{View, World};

/// See the module.
pub struct Local {
    simulation: Box<dyn Simulation>,
    agents: usize,
    sensors: usize,
    actuators: usize,
    metrics: Vec<String>,
    /// Of each of the model's metrics, its place among the simulation's.
    places: Vec<usize>,
    /// Of the acting agents, in their order.
    acting: Vec<f32>,
    view: View,
}

impl Local {
    /// The simulation of a model.
    pub fn new(model: &Model) -> Result<Self, String> {
        let simulation = worlds::create(&model.title).ok_or_else(|| {
            let titles = worlds::titles().join(", ");
            format!(
                "simulation {} does not exist; available: {titles}",
                model.title
            )
        })?;
        Ok(Self {
            simulation,
            agents: model.agents,
            sensors: model.sensors,
            actuators: model.actuators,
            metrics: model.metrics.clone(),
            places: Vec::new(),
            acting: Vec::new(),
            view: View {
                sensors: vec![0.0; model.agents * model.sensors],
                acts: vec![false; model.agents],
                metrics: vec![f64::NAN; model.metrics.len()],
                fitness: f64::NAN,
                done: false,
            },
        })
    }

    /// Reads everything that can be read.
    fn look(&mut self) -> Result<(), String> {
        let Self {
            simulation, view, ..
        } = self;
        view.acts.fill(false);
        view.done = simulation.done();
        let acting = simulation.acting();
        let most = acting.last().map_or(0, |last| *last as usize + 1);
        if most > self.agents {
            // Where agents act in turn, there may be others.
            let or_more = if acting.len() == most { "" } else { " or more" };
            return Err(format!(
                "the parameters make {most} agents{or_more}, but the FMU has variables for {}; export it again with these \
                 parameters (swarmwright export-fmu --set)",
                self.agents
            ));
        }
        for agent in acting {
            let index = *agent as usize;
            view.acts[index] = true;
            let row = index * self.sensors..(index + 1) * self.sensors;
            simulation.sense(*agent, &mut view.sensors[row]);
        }
        view.fitness = simulation.fitness();
        worlds::measure(simulation.as_ref(), &self.places, &mut view.metrics);
        Ok(())
    }
}

impl World for Local {
    fn begin(&mut self, parameters: &Parameters, _: &Parameters) -> Result<(), String> {
        self.view.sensors.fill(0.0);
        guarded(|| self.simulation.reset(parameters))
            .map_err(|failure| failure.reason)?
            .map_err(|error| error.to_string())?;
        let description = self.simulation.description();
        let (actual, expected) = (
            (description.sensors, description.actuators),
            (self.sensors, self.actuators),
        );
        if actual != expected {
            return Err(format!(
                "with these parameters an agent has {} sensors and {} actuators, but the FMU has variables for {} and {}; export \
                 it again with these parameters (swarmwright export-fmu --set)",
                actual.0, actual.1, expected.0, expected.1
            ));
        }
        self.places = description
            .metrics_named(&self.metrics)
            .map_err(|error| error.to_string())?;
        guarded(|| self.look()).map_err(|failure| failure.reason)?
    }

    fn step(&mut self, actuators: &[f32]) -> Result<(), String> {
        self.acting.clear();
        for agent in self.simulation.acting() {
            let start = *agent as usize * self.actuators;
            self.acting
                .extend_from_slice(&actuators[start..start + self.actuators]);
        }
        guarded(|| {
            self.simulation.step(&self.acting);
            self.look()
        })
        .map_err(|failure| failure.reason)?
    }

    fn view(&self) -> &View {
        &self.view
    }
}
