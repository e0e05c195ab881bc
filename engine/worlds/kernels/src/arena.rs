//! The arena as a simulation, one episode at a time.

use std::sync::Arc;

use swarmwright_arena::{
    Group as Kind, MOST_ROBOTS, Mistakes, Settings, Swarm, Tally, parameters, scene,
};
use swarmwright_lanes::Level;
use swarmwright_simulation::simulation::Describer;
use swarmwright_simulation::{
    Block, Description, Determinism, Group, Means, MetricInfo, ParameterError, ParameterInfo,
    Parameters, RolloutError, Scene, Side, Simulation, block,
};

use crate::lanes::{evaluate, vectors};

/// The arena simulation.
pub struct Arena {
    pub(crate) settings: Settings,
    pub(crate) swarm: Swarm<f32>,
    tallies: Vec<Tally<f32>>,
    pub(crate) acting: Vec<u32>,
}

impl Arena {
    fn new(settings: Settings) -> Result<Self, ParameterError> {
        let layout = &settings.mission.place;
        let swarm = Swarm::new(&settings.team, &layout.objects);
        let mut arena = Self {
            settings,
            swarm,
            tallies: Vec::new(),
            acting: Vec::new(),
        };
        arena.start()?;
        Ok(arena)
    }

    fn start(&mut self) -> Result<(), ParameterError> {
        let settings = &self.settings;
        let (mission, team) = (&settings.mission, &settings.team);
        let starts = settings.starts()?;
        self.swarm.start(
            team,
            &mission.place,
            (&settings.failures, &mission.rules),
            |_| settings.seed,
            |_, index| starts.robots[index],
            |_, index| starts.objects[index],
        );
        self.tallies.clear();
        self.tallies
            .extend((0..mission.counted).map(|_| Tally::default()));
        self.acting.clear();
        self.acting.extend(0..team.len() as u32);
        self.count();
        self.end();
        Ok(())
    }

    /// Returns the value of a metric. Before the end, returns the value as if the episode ended now; only viewers read
    /// it then.
    fn value(&self, index: usize) -> f64 {
        let mission = &self.settings.mission;
        mission.value(index, |metric| self.measured(metric))
    }

    /// Returns the value of a metric that is no sum.
    fn measured(&self, index: usize) -> f64 {
        let mission = &self.settings.mission;
        let now = |tally: &Tally<f32>| {
            let (_, metric) = &mission.metrics[index];
            let (bodies, colors) = (&self.swarm.bodies, &self.swarm.colors);
            tally.now(metric, bodies, &mission.place, colors)
        };
        match self.tallies.get(index) {
            Some(tally) if self.swarm.tick >= self.settings.ticks => tally.values[0],
            Some(tally) => now(tally),
            None => now(&Tally::default()),
        }
    }

    /// Updates the metrics with the current state.
    pub(crate) fn count(&mut self) {
        let mission = &self.settings.mission;
        let last = self.swarm.tick == self.settings.ticks;
        for ((_, metric), tally) in mission.metrics.iter().zip(&mut self.tallies) {
            tally.update(
                metric,
                &self.swarm.bodies,
                &mission.place,
                &self.swarm.colors,
                (self.swarm.tick, last),
            );
        }
    }

    pub(crate) fn end(&mut self) {
        if self.swarm.tick >= self.settings.ticks {
            self.acting.clear();
        }
    }
}

impl Default for Arena {
    #[expect(clippy::expect_used, reason = "tests read all built-in missions")]
    fn default() -> Self {
        let settings = Settings::read(&Parameters::new()).expect("the default mission is sound");
        Self::new(settings).expect("twenty robots fit")
    }
}

pub(crate) fn describe(settings: &Settings) -> Description {
    let metrics = settings.mission.metrics.iter();
    Description {
        title: "arena".to_owned(),
        dimensions: 2,
        max_agents: Some(MOST_ROBOTS),
        sensors: settings.team.sensors(),
        actuators: settings.team.actuators(),
        metrics: metrics
            .map(|(name, metric)| MetricInfo {
                name: name.clone().into(),
                unit: metric.unit().into(),
                description: metric.description().into(),
            })
            .collect(),
        determinism: Determinism::Bitwise,
    }
}

impl Simulation for Arena {
    fn description(&self) -> Description {
        describe(&self.settings)
    }

    fn describer(&self) -> Option<Describer> {
        Some(Arc::new(|parameters| {
            Settings::read(parameters).map(|settings| describe(&settings))
        }))
    }

    fn parameters(&self) -> Vec<ParameterInfo> {
        parameters()
    }

    fn mistakes(&self, parameters: &Parameters) -> Option<Vec<ParameterError>> {
        let start = |settings: Settings| settings.starts().map(|_| ()).map_err(Into::into);
        let read = Settings::read_all(parameters).and_then(start);
        Some(read.err().map(Mistakes::into_all).unwrap_or_default())
    }

    fn sensor_names(&self) -> Vec<String> {
        self.settings.team.sensor_names()
    }

    fn sensor_units(&self) -> Vec<String> {
        vec![String::new(); self.settings.team.sensors()]
    }

    fn actuator_units(&self) -> Vec<String> {
        vec![String::new(); self.settings.team.actuators()]
    }

    fn actuator_names(&self) -> Vec<String> {
        self.settings.team.actuator_names()
    }

    fn reset(&mut self, parameters: &Parameters) -> Result<(), ParameterError> {
        let settings = Settings::read(parameters)?;
        let objects = &settings.mission.place.objects;
        if settings.team != self.settings.team || *objects != self.settings.mission.place.objects {
            self.swarm = Swarm::new(&settings.team, objects);
        }
        self.settings = settings;
        self.start()
    }

    /// Returns the kinds of robots if there are several. All kinds have equally many sensors and actuators; missing
    /// ones are 0.
    fn groups(&self) -> Vec<Group> {
        let team = &self.settings.team;
        if team.groups().len() < 2 {
            return Vec::new();
        }
        let group = |(index, kind): (usize, &Kind)| {
            let own = team.own_names(index);
            Group {
                name: kind.name.clone().into(),
                agents: kind.count as u32,
                sensors: team.sensors(),
                actuators: team.actuators(),
                padded: true,
                sensor_names: team.sensor_names(),
                actuator_names: team.actuator_names(),
                own_sensor_names: own.sensors.clone(),
                own_actuator_names: own.actuators.clone(),
            }
        };
        team.groups().iter().enumerate().map(group).collect()
    }

    fn sides(&self) -> Vec<Side> {
        let Settings { mission, team, .. } = &self.settings;
        let mut sides = mission.sides.clone();
        let names: Vec<&str> = team.groups().iter().map(|group| &group.name[..]).collect();
        // In the order of their robots.
        sides.sort_by_key(|side| {
            let robots = side.groups.iter();
            robots
                .filter_map(|kind| names.iter().position(|name| name == kind))
                .min()
        });
        sides
    }

    fn acting(&self) -> &[u32] {
        &self.acting
    }

    fn sense(&self, agent: u32, sensors: &mut [f32]) {
        let width = sensors.len();
        let outputs = &self.swarm.senses.outputs;
        if let Some(numbers) = outputs.get(agent as usize * width..(agent as usize + 1) * width) {
            sensors.copy_from_slice(numbers);
        }
    }

    fn step(&mut self, actuators: &[f32]) {
        if self.acting.is_empty() {
            return;
        }
        let mission = &self.settings.mission;
        self.swarm
            .step(&self.settings.team, &mission.place, actuators);
        self.count();
        self.end();
    }

    fn fitness(&self) -> f64 {
        self.settings
            .mission
            .fitness(|metric| self.measured(metric))
    }

    fn metrics(&self) -> Vec<f64> {
        let metrics = 0..self.settings.mission.metrics.len();
        metrics.map(|index| self.value(index)).collect()
    }

    fn evaluate(
        &mut self,
        block: &Block<'_>,
        means: Means,
    ) -> Option<Result<Vec<f64>, RolloutError>> {
        let description = || self.described(block.parameters);
        let create = || Box::<Self>::default() as Box<dyn Simulation>;
        Some(block::evaluate_fitting(
            block,
            means,
            create,
            evaluate,
            description,
        ))
    }

    fn duplicate(&self) -> Option<Box<dyn Simulation>> {
        Self::new(self.settings.clone())
            .ok()
            .map(|arena| Box::new(arena) as Box<dyn Simulation>)
    }

    fn lanes(&self) -> usize {
        match Level::best() {
            // Episodes run one at a time at this level.
            Level::Portable => 1,
            level => level.width() * vectors(self.settings.team.len()),
        }
    }

    fn has_scenes(&self) -> bool {
        true
    }

    fn scene(&self) -> Option<Scene> {
        Some(scene(&self.settings, &self.swarm))
    }

    fn step_size(&self) -> u64 {
        u64::from(self.settings.step_size)
    }
}
