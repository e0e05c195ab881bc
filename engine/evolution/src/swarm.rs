//! Flights of particle swarms (Kennedy and Eberhart, ICNN 1995), and how far a swarm is spread (Zhan et al., 2009).

use swarmwright_lanes::{Kernel, Lanes, Level};

use crate::Stream;
use crate::differential::within;
use crate::polynomial::mutate;

/// 2^-32, the distance of two neighbouring shares.
const SHARE: f64 = 1.0 / 4_294_967_296.0;

/// Flights that leave the box are drawn again so often, before they end between the bound and where they began.
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
    /// Where it is.
    pub from: &'a [f32],
    /// The best place where it has been.
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
        self.fly_in(&mut Room::default(), flight, stream, velocity, to);
    }

    /// As [`fly`](Self::fly), with room for numbers that is used again.
    pub(crate) fn fly_in(
        &self,
        room: &mut Room,
        flight: Flight<'_>,
        stream: &mut Stream,
        velocity: &mut [f64],
        to: &mut [f64],
    ) {
        let genes = to.len();
        for row in [flight.from, flight.own, flight.social] {
            assert_eq!(row.len(), genes);
        }
        for row in [self.fastest, self.lower, self.upper, velocity] {
            assert_eq!(row.len(), genes);
        }
        room.words.resize(genes, 0);
        room.before.clear();
        room.before.extend_from_slice(velocity);
        for _ in 0..=ATTEMPTS {
            stream.fill(&mut room.words);
            let inside = Level::best().run(Attempt {
                swarm: self,
                flight,
                words: &room.words,
                before: &room.before,
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

    /// Returns in `to` a place near the best one, by polynomial mutation, instead of a flight.
    pub fn perturb(&self, best: &[f32], stream: &mut Stream, to: &mut [f64]) {
        for (place, value) in to.iter_mut().zip(best) {
            *place = f64::from(*value);
        }
        let precision = 5.0 + 25.0 * stream.unit();
        mutate(stream, to, self.lower, self.upper, precision);
    }
}

/// Room for numbers of a flight.
#[derive(Debug, Default)]
pub(crate) struct Room {
    words: Vec<u64>,
    before: Vec<f64>,
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
            let place = at + speed;
            to[gene] = place;
            outside |= u64::from(!(place >= lower[gene] && place <= upper[gene]));
        }
        outside == 0
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
    for (place, row) in places.chunks_exact(genes.max(1)).enumerate() {
        for (gene, value) in scaled(row, width).enumerate() {
            columns[gene * count + place] = value;
        }
    }
    let mut distances = vec![0.0; count];
    let mut mean = |from: &[f64], among: f64| {
        Level::best().run(Distances {
            from,
            columns: &columns,
            distances: &mut distances,
        });
        distances.iter().sum::<f64>() / among
    };
    #[expect(clippy::cast_precision_loss, reason = "numbers of particles are small")]
    let others = count as f64 - 1.0;
    let (mut least, mut most) = (f64::INFINITY, 0.0_f64);
    for row in places.chunks_exact(genes.max(1)) {
        let row: Vec<f64> = scaled(row, width).collect();
        let distance = mean(&row, others);
        (least, most) = (least.min(distance), most.max(distance));
    }
    let best: Vec<f64> = scaled(best, width).collect();
    (mean(&best, others + 1.0) - least) / (most - least + 1e-32)
}

fn scaled<'a>(row: &'a [f32], width: &'a [f64]) -> impl Iterator<Item = f64> + 'a {
    row.iter()
        .zip(width)
        .map(|(value, width)| f64::from(*value) / width)
}

/// Distances of one place to all; its squares are added gene after gene.
struct Distances<'a> {
    from: &'a [f64],
    /// (genes, places)
    columns: &'a [f64],
    distances: &'a mut [f64],
}

impl Kernel for Distances<'_> {
    type Output = ();

    /// Lanes of binary64 are left to the compiler: no distance depends on another.
    #[inline(always)]
    fn run<L: Lanes>(self) {
        self.distances.fill(0.0);
        let columns = self.columns.chunks_exact(self.distances.len().max(1));
        for (from, column) in self.from.iter().zip(columns) {
            for (square, place) in self.distances.iter_mut().zip(column) {
                let difference = from - place;
                *square += difference * difference;
            }
        }
        for distance in &mut *self.distances {
            *distance = distance.sqrt();
        }
    }
}
