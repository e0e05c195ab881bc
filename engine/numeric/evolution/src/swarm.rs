//! Flights of particle swarms (Kennedy and Eberhart, ICNN 1995), and how far a swarm is spread (Zhan et al., 2009).

use swarmwright_lanes::{Kernel, Lanes, Level};

use crate::differential::within;
use crate::polynomial::mutate;
use crate::stream::{SIDE, Stream, Streams};

/// 2^-32, the distance of two neighbouring shares.
const SHARE: f64 = 1.0 / 4_294_967_296.0;

/// Number of attempts for flights that leave the box, before they end between the bound and their start.
const ATTEMPTS: usize = 20;

/// Settings of a particle swarm in a box.
#[derive(Debug, Clone, Copy)]
pub struct Swarm<'a> {
    /// w: share of a particle's velocity that it keeps.
    pub inertia: f64,
    /// c1: pull of the best place where a particle has been.
    pub own: f64,
    /// c2: pull of the best place where any particle has been.
    pub social: f64,
    /// Largest velocity of each gene.
    pub fastest: &'a [f64],
    /// Least value of each gene.
    pub lower: &'a [f64],
    /// Largest value of each gene.
    pub upper: &'a [f64],
}

/// A particle before it flies; all of as many genes.
#[derive(Debug, Clone, Copy)]
pub struct Flight<'a> {
    /// Its position.
    pub from: &'a [f32],
    /// The best position that it has visited.
    pub own: &'a [f32],
    /// The best place where any particle has been.
    pub social: &'a [f32],
}

impl Swarm<'_> {
    /// Moves a particle: changes its velocity, and returns in `to` where it then is.
    ///
    /// Each gene takes a word of the stream: its upper half, a multiple of 2^-32, is the share of the own pull, its lower half
    /// that of the common one.
    ///
    /// # Panics
    ///
    /// When lengths do not fit together.
    pub fn fly(
        &self,
        flight: Flight<'_>,
        stream: &mut Stream,
        velocity: &mut [f64],
        to: &mut [f64],
    ) {
        let before = velocity.to_vec();
        self.fly_from(0, flight, &before, stream, velocity, to);
    }

    /// As [`fly`](Self::fly), where a particle with the velocity `before` has made so many attempts already.
    fn fly_from(
        &self,
        attempts: usize,
        flight: Flight<'_>,
        before: &[f64],
        stream: &mut Stream,
        velocity: &mut [f64],
        to: &mut [f64],
    ) {
        let genes = to.len();
        for row in [flight.from, flight.own, flight.social] {
            assert_eq!(row.len(), genes);
        }
        for row in [self.fastest, self.lower, self.upper, before, velocity] {
            assert_eq!(row.len(), genes);
        }
        let mut words = vec![0; genes];
        for _ in attempts..=ATTEMPTS {
            stream.fill(&mut words);
            let inside = Level::best().run(Attempt {
                swarm: self,
                flight,
                words: &words,
                before,
                velocity,
                to,
            });
            if inside {
                return;
            }
        }
        for (gene, value) in to.iter_mut().enumerate() {
            let from = f64::from(flight.from[gene]);
            *value = within(stream, *value, from, self.lower[gene], self.upper[gene]);
        }
    }

    /// Moves particles that follow each other, rows of as many genes, as [`fly`](Self::fly) does with the stream of each.
    ///
    /// `from`, `own`: rows. `genomes`: where they are then, rounded to binary32.
    ///
    /// # Panics
    ///
    /// When lengths do not fit together.
    pub(crate) fn fly_all(
        &self,
        (from, own, social): (&[f32], &[f32], &[f32]),
        streams: Streams,
        velocities: &mut [f64],
        genomes: &mut [f32],
    ) {
        let genes = social.len();
        for rows in [from, own, &*genomes] {
            assert_eq!(rows.len(), velocities.len());
        }
        for row in [self.fastest, self.lower, self.upper] {
            assert_eq!(row.len(), genes);
        }
        if genes == 0 {
            return;
        }
        let outside = Level::best().run(FirstAttempts {
            swarm: self,
            rows: (from, own, social),
            streams,
            velocities,
            genomes,
        });
        let (mut velocity, mut to) = (vec![0.0; genes], vec![0.0; genes]);
        for particle in outside {
            let its = particle * genes..(particle + 1) * genes;
            let flight = Flight {
                from: &from[its.clone()],
                own: &own[its.clone()],
                social,
            };
            let mut stream = streams.of(particle);
            stream.skip(genes);
            let before = &velocities[its.clone()];
            self.fly_from(1, flight, before, &mut stream, &mut velocity, &mut to);
            velocities[its.clone()].copy_from_slice(&velocity);
            rounded(&to, self.lower, self.upper, &mut genomes[its]);
        }
    }

    /// Returns in `to` a place near the best one, by polynomial mutation, instead of a flight.
    pub fn perturb(&self, best: &[f32], stream: &mut Stream, to: &mut [f64]) {
        for (slot, value) in to.iter_mut().zip(best) {
            *slot = f64::from(*value);
        }
        let precision = 5.0 + 25.0 * stream.unit();
        mutate(stream, to, self.lower, self.upper, precision);
    }
}

/// The first flights of particles; those that leave the box are found, and are where they were.
struct FirstAttempts<'a, 'b> {
    swarm: &'a Swarm<'b>,
    /// Where particles are, their best places, and the best of all.
    rows: (&'a [f32], &'a [f32], &'a [f32]),
    streams: Streams,
    velocities: &'a mut [f64],
    genomes: &'a mut [f32],
}

impl Kernel for FirstAttempts<'_, '_> {
    /// The particles that leave it.
    type Output = Vec<usize>;

    #[inline(always)]
    fn run<L: Lanes>(self) -> Vec<usize> {
        let (from, own, social) = self.rows;
        let genes = social.len();
        let (mut words, mut fresh, mut to) =
            (vec![0; SIDE * genes], vec![0.0; genes], vec![0.0; genes]);
        let mut outside = Vec::new();
        let groups = self.genomes.chunks_mut(SIDE * genes);
        for (group, genomes) in groups.enumerate() {
            let first = group * SIDE;
            let words = &mut words[..genomes.len()];
            self.streams.fill_rows::<L>(first, genes, words);
            let particles = genomes
                .chunks_exact_mut(genes)
                .zip(words.chunks_exact(genes));
            for (particle, (genome, words)) in (first..).zip(particles) {
                let its = particle * genes..(particle + 1) * genes;
                let velocity = &mut self.velocities[its.clone()];
                let inside = Attempt {
                    swarm: self.swarm,
                    flight: Flight {
                        from: &from[its.clone()],
                        own: &own[its],
                        social,
                    },
                    words,
                    before: velocity,
                    velocity: &mut fresh,
                    to: &mut to,
                }
                .run::<L>();
                if inside {
                    velocity.copy_from_slice(&fresh);
                    rounded(&to, self.swarm.lower, self.swarm.upper, genome);
                } else {
                    outside.push(particle);
                }
            }
        }
        outside
    }
}

/// One flight of a particle, with two random shares for each gene.
struct Attempt<'a, 'b> {
    swarm: &'a Swarm<'b>,
    flight: Flight<'a>,
    words: &'a [u64],
    /// The velocity that the particle has.
    before: &'a [f64],
    /// The one that it gets.
    velocity: &'a mut [f64],
    to: &'a mut [f64],
}

impl Kernel for Attempt<'_, '_> {
    /// Whether it has stayed in the box.
    type Output = bool;

    /// Lanes of binary64 are left to the compiler: no gene depends on another.
    #[expect(clippy::cast_possible_truncation, reason = "halves of words are meant")]
    #[inline(always)]
    fn run<L: Lanes>(self) -> bool {
        let genes = self.to.len();
        let (swarm, flight) = (self.swarm, self.flight);
        let (from, own, social) = (
            &flight.from[..genes],
            &flight.own[..genes],
            &flight.social[..genes],
        );
        let (lower, upper) = (&swarm.lower[..genes], &swarm.upper[..genes]);
        let (fastest, before) = (&swarm.fastest[..genes], &self.before[..genes]);
        let (velocity, to) = (&mut self.velocity[..genes], &mut self.to[..genes]);
        let words = &self.words[..genes];
        // A power of two changes no bit of the products.
        let (pull_own, pull_social) = (swarm.own * SHARE, swarm.social * SHARE);
        let mut outside = 0_u64;
        for gene in 0..genes {
            let at = f64::from(from[gene]);
            let (upper_half, lower_half) = ((words[gene] >> 32) as u32, words[gene] as u32);
            let toward_own = pull_own * f64::from(upper_half) * (f64::from(own[gene]) - at);
            let toward_best = pull_social * f64::from(lower_half) * (f64::from(social[gene]) - at);
            let most = fastest[gene];
            let speed = swarm.inertia * before[gene] + toward_own + toward_best;
            let speed = if speed < -most { -most } else { speed };
            let speed = if speed > most { most } else { speed };
            velocity[gene] = speed;
            let position = at + speed;
            to[gene] = position;
            outside |= u64::from(!(position >= lower[gene] && position <= upper[gene]));
        }
        outside == 0
    }
}

/// A genome: within the bounds, rounded to binary32; what is not a number becomes the lower bound.
#[expect(clippy::cast_possible_truncation, reason = "genomes are binary32")]
#[inline(always)]
pub(crate) fn rounded(values: &[f64], lower: &[f64], upper: &[f64], genome: &mut [f32]) {
    let bounds = lower.iter().zip(upper);
    for (slot, (value, (lower, upper))) in genome.iter_mut().zip(values.iter().zip(bounds)) {
        let value = if value >= lower { value } else { lower };
        *slot = *(if value > upper { upper } else { value }) as f32;
    }
}

/// How far the swarm's best places are from that of all, 0 (nearest to the others) to 1 (farthest); it may be beyond.
///
/// `places` are rows of `width.len()` numbers, at least two; distances are in units of `width`, which is positive.
///
/// # Panics
///
/// When lengths do not fit together.
#[must_use]
pub fn spread(places: &[f32], best: &[f32], width: &[f64]) -> f64 {
    let genes = width.len();
    assert_eq!(best.len(), genes);
    let count = places.len().checked_div(genes).unwrap_or(0);
    assert_eq!(places.len(), count * genes);
    // A row for each gene, so that what is computed for all places side by side lies side by side.
    let mut columns = vec![0.0; places.len()];
    for (index, row) in places.chunks_exact(genes.max(1)).enumerate() {
        for (gene, value) in scaled(row, width).enumerate() {
            columns[gene * count + index] = value;
        }
    }
    let mut distances = vec![0.0; count];
    let mut sums = vec![0.0; count];
    let distances_to = |from: &[f32], first: usize, distances: &mut [f64]| {
        let from: Vec<f64> = scaled(from, width).collect();
        Level::best().run(Distances {
            from: &from,
            columns: &columns,
            first,
            distances,
        });
    };
    // Each pair once. A sum has its distances in the order of the places: those before a place are in it when its turn comes.
    for (index, row) in places.chunks_exact(genes.max(1)).enumerate() {
        let distances = &mut distances[index + 1..];
        distances_to(row, index + 1, distances);
        let (before, after) = sums.split_at_mut(index + 1);
        for (sum, distance) in after.iter_mut().zip(&*distances) {
            *sum += distance;
        }
        before[index] = distances.iter().fold(before[index], |sum, next| sum + next);
    }
    #[expect(clippy::cast_precision_loss, reason = "numbers of particles are small")]
    let others = count as f64 - 1.0;
    let (mut least, mut most) = (f64::INFINITY, 0.0_f64);
    for sum in sums {
        let distance = sum / others;
        (least, most) = (least.min(distance), most.max(distance));
    }
    distances_to(best, 0, &mut distances);
    let mean = distances.iter().sum::<f64>() / (others + 1.0);
    (mean - least) / (most - least + 1e-32)
}

fn scaled<'a>(row: &'a [f32], width: &'a [f64]) -> impl Iterator<Item = f64> + 'a {
    row.iter()
        .zip(width)
        .map(|(value, width)| f64::from(*value) / width)
}

/// Distances of a position to all others from the first one on; their squares are added gene by gene.
struct Distances<'a> {
    from: &'a [f64],
    /// (genes, places)
    columns: &'a [f64],
    first: usize,
    distances: &'a mut [f64],
}

impl Kernel for Distances<'_> {
    type Output = ();

    /// Lanes of binary64 are left to the compiler: no distance depends on another.
    #[inline(always)]
    fn run<L: Lanes>(self) {
        self.distances.fill(0.0);
        let count = self.first + self.distances.len();
        let columns = self.columns.chunks_exact(count.max(1));
        for (from, column) in self.from.iter().zip(columns) {
            for (square, to) in self.distances.iter_mut().zip(&column[self.first..]) {
                let difference = from - to;
                *square += difference * difference;
            }
        }
        for distance in &mut *self.distances {
            *distance = distance.sqrt();
        }
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    proptest! {
        #[test]
        fn particles_fly_together_as_one_by_one(
            seed: u64, first in 0_u64..1000, count in 0_usize..40, genes in 1_usize..60, wide in 0.2..6.0_f64,
        ) {
            let streams = Streams { seed, purpose: 7, generation: 3, first };
            // The narrower the box, the more of them leave it, some until they have no attempt left.
            let (lower, upper) = (vec![-wide; genes], vec![wide; genes]);
            let fastest = vec![1.5; genes];
            let swarm = Swarm {
                inertia: 0.6,
                own: 1.7,
                social: 1.7,
                fastest: &fastest,
                lower: &lower,
                upper: &upper,
            };
            let number = |of: usize| {
                let mut numbers = Stream::new(seed, 8, 0, of as u64);
                move |_| numbers.uniform(wide)
            };
            let row = |of| -> Vec<f32> {
                let values: Vec<f64> = (0..count * genes).map(number(of)).collect();
                let (low, high) = (vec![-wide; values.len()], vec![wide; values.len()]);
                let mut row = vec![0.0; values.len()];
                rounded(&values, &low, &high, &mut row);
                row
            };
            let (from, own, social) = (row(1), row(2), vec![0.1; genes]);
            let mut velocities: Vec<f64> = (0..count * genes).map(number(3)).collect();
            let (mut expected, mut moved) = (vec![0.0; count * genes], velocities.clone());
            let mut to = vec![0.0; genes];
            for particle in 0..count {
                let its = particle * genes..(particle + 1) * genes;
                let flight = Flight { from: &from[its.clone()], own: &own[its.clone()], social: &social };
                swarm.fly(flight, &mut streams.of(particle), &mut moved[its.clone()], &mut to);
                rounded(&to, &lower, &upper, &mut expected[its]);
            }
            let mut genomes = vec![0.0; count * genes];
            swarm.fly_all((&from, &own, &social), streams, &mut velocities, &mut genomes);
            prop_assert_eq!(genomes, expected);
            prop_assert_eq!(velocities, moved);
        }
    }
}
