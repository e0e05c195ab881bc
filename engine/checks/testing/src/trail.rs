//! A simulation whose fitness tells who computed it, with which seed, and whether a step was missed or made twice.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

use swarmwright_worlds::{Description, Determinism, ParameterError, Parameters, Simulation, fail};

/// Agents of every episode.
pub const AGENTS: usize = 2;
/// The speed that agents which steer themselves fail at; its negative is deadly.
pub const EXTREME_SPEED: f32 = 1000.0;

/// Agents on a line. They start at 0, each moves by its actuator or, steered by parameters, by `speed`, and stops after
/// its own number of steps. The fitness weighs the places by agent.
pub struct Trail {
    title: &'static str,
    seed: f32,
    speed: Option<f32>,
    places: [f32; AGENTS],
    acting: Vec<u32>,
    step: u32,
    /// Set when the process that runs this would have died.
    died: Arc<AtomicBool>,
    /// Whether everything fails.
    broken: Arc<AtomicBool>,
}

impl Trail {
    /// A trail that tells with `died` that its process would have died, and fails as long as it is `broken`.
    #[must_use]
    pub fn new(title: &'static str, died: Arc<AtomicBool>, broken: Arc<AtomicBool>) -> Self {
        Self {
            title,
            seed: 0.0,
            speed: None,
            places: [0.0; AGENTS],
            acting: Vec::new(),
            step: 0,
            died,
            broken,
        }
    }

    fn last_step(&self, agent: u32) -> u32 {
        let odd = self.seed.rem_euclid(2.0) >= 1.0;
        2 + agent + u32::from(odd)
    }
}

impl Simulation for Trail {
    fn description(&self) -> Description {
        Description {
            title: self.title.into(),
            dimensions: 2,
            max_agents: Some(100),
            sensors: 2,
            actuators: 1,
            metrics: (&[][..]).into(),
            determinism: Determinism::Bitwise,
        }
    }

    fn reset(&mut self, parameters: &Parameters) -> Result<(), ParameterError> {
        if self.broken.load(Ordering::Relaxed) {
            fail("a library is missing".to_owned());
        }
        #[expect(
            clippy::cast_possible_truncation,
            reason = "small numbers, and binary32 on the wire"
        )]
        let number = |name: &str| Some(parameters.get(name)?.as_f64()? as f32);
        self.seed = number("seed").ok_or_else(|| ParameterError {
            name: "seed".to_owned(),
            reason: "is missing".to_owned(),
        })?;
        self.speed = number("speed");
        self.places = [0.0; AGENTS];
        self.acting = (0..).take(AGENTS).collect();
        self.step = 0;
        Ok(())
    }

    fn acting(&self) -> &[u32] {
        if self.speed.is_some() {
            &[]
        } else {
            &self.acting
        }
    }

    fn done(&self) -> bool {
        self.acting.is_empty()
    }

    fn sense(&self, agent: u32, sensors: &mut [f32]) {
        sensors[0] = self.places[agent as usize];
        sensors[1] = self.seed;
    }

    fn step(&mut self, actuators: &[f32]) {
        let extreme = |bound: f32| {
            let speed = self.speed.iter().map(|speed| speed / EXTREME_SPEED);
            speed
                .chain(actuators.iter().copied())
                .any(|number| number / bound >= 0.999)
        };
        if extreme(1.0) {
            fail("an agent ran away".to_owned());
        }
        if extreme(-1.0) {
            self.died.store(true, Ordering::Relaxed);
            fail("the process died".to_owned());
        }
        for (row, &agent) in self.acting.iter().enumerate() {
            let step = self
                .speed
                .or_else(|| actuators.get(row).copied())
                .unwrap_or(f32::NAN);
            self.places[agent as usize] += step + self.seed / 64.0;
        }
        self.step += 1;
        let (step, acting) = (self.step, std::mem::take(&mut self.acting));
        self.acting = acting
            .into_iter()
            .filter(|&agent| step < self.last_step(agent))
            .collect();
    }

    fn fitness(&self) -> f64 {
        let [first, second] = self.places.map(f64::from);
        first + 3.0 * second
    }

    fn duplicate(&self) -> Option<Box<dyn Simulation>> {
        let (died, broken) = (Arc::clone(&self.died), Arc::clone(&self.broken));
        Some(Box::new(Self::new(self.title, died, broken)))
    }
}
