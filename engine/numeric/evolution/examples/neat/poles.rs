//! Two poles of different lengths on a cart (A. P. Wieland, "Evolving neural network controllers for unstable systems", IJCNN 1991), with
//! the constants of Stanley and Miikkulainen.

use swarmwright_controllers::Controller;

const GRAVITY: f64 = -9.8;
const CART: f64 = 1.0;
/// Mass and half length of each pole.
const POLES: [(f64, f64); 2] = [(0.1, 0.5), (0.01, 0.05)];
const FRICTION: f64 = 0.000_002;
const FORCE: f64 = 10.0;
/// Seconds; an action lasts two steps.
const STEP: f64 = 0.01;
const TRACK: f64 = 2.4;
/// 36 degrees.
const FALLEN: f64 = 0.628_329;

/// Position and velocity of the cart, angle and angular velocity of each pole.
#[derive(Debug, Clone, Copy)]
pub struct Poles([f64; 6]);

type Sensors = fn(&Poles) -> Vec<f32>;

impl Poles {
    /// With this angle of the longer pole.
    pub fn new(angle: f64) -> Self {
        Self([0.0, 0.0, angle, 0.0, 0.0, 0.0])
    }

    pub fn with_velocities(&self) -> Vec<f32> {
        let scales = [4.8, 2.0, 0.52, 2.0, 0.52, 2.0];
        self.0
            .iter()
            .zip(scales)
            .map(|(value, scale)| (value / scale) as f32)
            .collect()
    }

    pub fn positions(&self) -> Vec<f32> {
        self.with_velocities().into_iter().step_by(2).collect()
    }

    fn has_fallen(&self) -> bool {
        let [x, _, long, _, short, _] = self.0;
        x.abs() > TRACK || long.abs() > FALLEN || short.abs() > FALLEN
    }

    fn derivatives(state: &[f64; 6], force: f64) -> [f64; 6] {
        let (mut forces, mut masses) = (force, CART);
        let mut parts = [(0.0, 0.0, 0.0); 2];
        for (pole, (mass, length)) in POLES.into_iter().enumerate() {
            let [angle, velocity] = [state[2 + 2 * pole], state[3 + 2 * pole]];
            let (sine, cosine) = angle.sin_cos();
            let (pull, friction) = (GRAVITY * sine, FRICTION * velocity / (length * mass));
            forces += mass * length * velocity * velocity * sine
                + 0.75 * mass * cosine * (friction + pull);
            masses += mass * (1.0 - 0.75 * cosine * cosine);
            parts[pole] = (cosine, pull + friction, length);
        }
        let acceleration = forces / masses;
        let angular =
            parts.map(|(cosine, pull, length)| -0.75 * (acceleration * cosine + pull) / length);
        [
            state[1],
            acceleration,
            state[3],
            angular[0],
            state[5],
            angular[1],
        ]
    }

    /// Two steps of the classical method of Runge and Kutta.
    fn push(&mut self, force: f64) {
        for _ in 0..2 {
            let along = |slope: &[f64; 6], time: f64| {
                std::array::from_fn(|index| self.0[index] + time * slope[index])
            };
            let first = Self::derivatives(&self.0, force);
            let second = Self::derivatives(&along(&first, STEP / 2.0), force);
            let third = Self::derivatives(&along(&second, STEP / 2.0), force);
            let fourth = Self::derivatives(&along(&third, STEP), force);
            self.0 = std::array::from_fn(|index| {
                self.0[index]
                    + STEP / 6.0
                        * (first[index] + 2.0 * (second[index] + third[index]) + fourth[index])
            });
        }
    }

    fn act(&mut self, controller: &mut Controller, sensors: Sensors) {
        let mut actuators = [0.0];
        controller.step(&sensors(self), &mut actuators).unwrap();
        self.push(FORCE * f64::from(actuators[0]));
    }

    /// Steps until it falls, or so many.
    pub fn balance(mut self, controller: &mut Controller, sensors: Sensors, most: usize) -> usize {
        controller.reset();
        for step in 0..most {
            self.act(controller, sensors);
            if self.has_fallen() {
                return step;
            }
        }
        most
    }

    /// Gruau's fitness: a tenth is the share of 1,000 steps, nine tenths the calm of the last 100 of them.
    pub fn gruau(mut self, controller: &mut Controller) -> f64 {
        controller.reset();
        let mut unrest = Vec::new();
        while unrest.len() < 1000 {
            self.act(controller, Self::positions);
            if self.has_fallen() {
                break;
            }
            unrest.push(self.0[..4].iter().map(|value| value.abs()).sum::<f64>());
        }
        let steps = unrest.len();
        let calm = if steps < 100 {
            0.0
        } else {
            0.75 / unrest[steps - 100..].iter().sum::<f64>()
        };
        0.1 * steps as f64 / 1000.0 + 0.9 * calm
    }

    /// From how many of 625 states it balances for 1,000 steps.
    pub fn generalization(controller: &mut Controller) -> usize {
        let values = [0.05, 0.25, 0.5, 0.75, 0.95];
        let ranges = [2.16, 1.35, 0.062_831_52, 0.150_097_52];
        let states = (0..625_usize).map(|number| {
            let of = |digit: u32| {
                (2.0 * values[number / 5_usize.pow(digit) % 5] - 1.0) * ranges[digit as usize]
            };
            Self([of(0), of(1), of(2), of(3), 0.0, 0.0])
        });
        states
            .filter(|state| state.balance(controller, Self::positions, 1000) == 1000)
            .count()
    }
}
