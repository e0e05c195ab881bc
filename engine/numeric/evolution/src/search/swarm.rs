//! A swarm of particles from generation to generation, with settings that may follow its state.

use rayon::prelude::*;

use crate::stream::{Stream, Streams, purpose_key, rows_of};
use crate::swarm::{Flight, Swarm, rounded, spread};

/// Genes of particles that fly in little more time than another thread takes to begin.
const FEW: usize = 1 << 14;

/// Settings of a swarm.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SwarmSettings {
    /// w: share of a particle's velocity that it keeps.
    pub inertia: f64,
    /// c1 and c2: pulls of the own and of the common best place.
    pub pulls: (f64, f64),
    /// Largest velocity, as a share of the box.
    pub fastest: f64,
    /// Whether inertia and pulls follow the state of the swarm (Zhan et al., IEEE Transactions on Systems, Man and Cybernetics B 39, 2009).
    pub adaptive: bool,
    /// Whether the best particle is mutated instead of moved.
    pub perturb: bool,
}

/// Particles, whose best places are members.
#[derive(Debug, Clone)]
pub struct Swarming {
    settings: SwarmSettings,
    /// Largest velocity of each gene.
    fastest: Vec<f64>,
    /// Positions of the particles, one per row.
    places: Vec<f32>,
    velocities: Vec<f64>,
}

impl Swarming {
    /// A swarm that has not begun.
    #[must_use]
    pub fn new(settings: SwarmSettings) -> Self {
        Self {
            settings,
            fastest: Vec::new(),
            places: Vec::new(),
            velocities: Vec::new(),
        }
    }

    /// Puts a particle at each of the first places, with a velocity drawn at random.
    pub(super) fn begin(&mut self, places: &[f32], width: &[f64], seed: u64) {
        let share = self.settings.fastest;
        self.fastest = width.iter().map(|width| share * width).collect();
        self.places = places.to_vec();
        self.velocities = vec![0.0; places.len()];
        let purpose = purpose_key("pso.velocity");
        let particles = self.velocities.chunks_exact_mut(width.len().max(1));
        for (particle, row) in (0..).zip(particles) {
            Stream::new(seed, purpose, 0, particle).units(row);
            for (velocity, fastest) in row.iter_mut().zip(&self.fastest) {
                *velocity *= fastest;
            }
        }
    }

    /// Notes where the particles are.
    pub(super) fn land(&mut self, places: &[f32]) {
        self.places.copy_from_slice(places);
    }

    /// Moves all particles; `best` is the member that all fly to.
    pub(super) fn fly(
        &mut self,
        members: &[f32],
        best: usize,
        (lower, upper): (&[f64], &[f64]),
        streams: Streams,
        genomes: &mut [f32],
    ) {
        let genes = lower.len();
        let settings = Swarm {
            inertia: self.settings.inertia,
            own: self.settings.pulls.0,
            social: self.settings.pulls.1,
            fastest: &self.fastest,
            lower,
            upper,
        };
        let its = best * genes..(best + 1) * genes;
        let social = &members[its.clone()];
        let part = |first: usize, velocities: &mut [f64], genomes: &mut [f32]| {
            let part = first * genes..first * genes + genomes.len();
            let rows = (&self.places[part.clone()], &members[part], social);
            let streams = Streams {
                first: first as u64,
                ..streams
            };
            settings.fly_all(rows, streams, velocities, genomes);
        };
        let moved = self
            .settings
            .perturb
            .then(|| self.velocities[its.clone()].to_vec());
        if genomes.len() < 2 * FEW {
            part(0, &mut self.velocities, genomes);
        } else {
            let rows = rows_of(FEW, genes);
            let velocities = self.velocities.par_chunks_mut(rows * genes);
            let parts = velocities.zip(genomes.par_chunks_mut(rows * genes));
            parts
                .enumerate()
                .for_each(|(number, (velocities, genomes))| {
                    part(number * rows, velocities, genomes);
                });
        }
        if let Some(mut velocity) = moved {
            let (mut stream, mut to) = (streams.of(best), vec![0.0; genes]);
            let flight = Flight {
                from: &self.places[its.clone()],
                own: social,
                social,
            };
            settings.fly(flight, &mut stream, &mut velocity, &mut to);
            settings.perturb(social, &mut stream, &mut to);
            rounded(&to, lower, upper, &mut genomes[its]);
        }
    }

    /// Sets inertia and pulls by how far the best place that all flew to is from the others; `address`: seed and generation.
    pub(super) fn adapt(
        &mut self,
        members: &[f32],
        leader: usize,
        width: &[f64],
        (seed, generation): (u64, u64),
    ) {
        if !self.settings.adaptive {
            return;
        }
        let genes = width.len();
        let scale: Vec<f64> = width
            .iter()
            .map(|width| if *width > 0.0 { *width } else { 1.0 })
            .collect();
        let best = &members[leader * genes..(leader + 1) * genes];
        let spread = spread(members, best, &scale);
        let change =
            0.05 + 0.05 * Stream::new(seed, purpose_key("pso.change"), generation, 0).unit();
        let (own, social) = self.settings.pulls;
        let signs = signs(spread);
        let own = (own + change * signs.0).clamp(1.5, 2.5);
        let social = (social + change * signs.1).clamp(1.5, 2.5);
        let sum = own + social;
        self.settings.pulls = if sum > 4.0 {
            (4.0 * own / sum, 4.0 * social / sum)
        } else {
            (own, social)
        };
        let decay = libm::exp((-2.6 * spread).clamp(-700.0, 700.0));
        self.settings.inertia = 1.0 / (1.0 + 1.5 * decay);
    }

    pub(super) fn state(&self, name: &str) -> Option<Vec<f64>> {
        match name {
            "inertia" => Some(vec![self.settings.inertia]),
            "pulls" => Some(vec![self.settings.pulls.0, self.settings.pulls.1]),
            _ => None,
        }
    }
}

/// How the pulls of the own and of the common best place change in the most likely state.
fn signs(spread: f64) -> (f64, f64) {
    const ALWAYS: f64 = f64::INFINITY;
    let states = [
        // Exploration, exploitation, convergence, jumping out.
        ((1.0, -1.0), [0.4, 0.6, 0.7, 0.8]),
        ((0.5, -0.5), [0.2, 0.3, 0.4, 0.6]),
        ((0.5, 0.5), [-ALWAYS, -ALWAYS, 0.1, 0.3]),
        ((-1.0, 1.0), [0.7, 0.9, ALWAYS, ALWAYS]),
    ];
    let mut likeliest = (states[0].0, trapezoid(spread, states[0].1));
    for (signs, corners) in &states[1..] {
        let likely = trapezoid(spread, *corners);
        if likely > likeliest.1 {
            likeliest = (*signs, likely);
        }
    }
    likeliest.0
}

/// 1 between the inner corners, 0 outside of the outer ones, and what is between, linearly.
fn trapezoid(value: f64, [start, first, last, end]: [f64; 4]) -> f64 {
    if first <= value && value <= last {
        1.0
    } else if value < first {
        ((value - start) / (first - start)).max(0.0)
    } else {
        ((end - value) / (end - last)).max(0.0)
    }
}

#[cfg(test)]
mod tests {
    use super::signs;

    #[test]
    fn signs_of_the_states() {
        let found = [-0.5, 0.1, 0.35, 0.65, 1.5].map(signs);
        let expected = [
            (0.5, 0.5),
            (0.5, 0.5),
            (0.5, -0.5),
            (1.0, -1.0),
            (-1.0, 1.0),
        ];
        assert_eq!(found, expected);
    }
}
