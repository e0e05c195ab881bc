//! NEAT: networks that grow, in species that share their fitness.

use std::cmp::Ordering;

use super::genetic::{mate, row, vary};
use super::{Operators, Search, Unavailable, Variation};
use crate::growing::{
    Aligned, Compatibility, GrowingNetwork, Network, WeightMutation, difference, index,
};
use crate::stream::{Stream, purpose_key, rows};

/// Species with more members keep their best one unchanged.
const LARGE: usize = 5;
/// Most species of a generation. Beyond these, genomes join the nearest species instead of founding one, which bounds the time that
/// large populations take.
const MOST_SPECIES: usize = 1000;
/// Step of a threshold that is adapted to a number of species, also its least value.
const THRESHOLD_STEP: f64 = 0.3;
/// Highest fitness of members that violate constraints, which `rank_feasible_first` of the Python library gives them.
const INFEASIBLE: f64 = -1e100;

/// Settings of the algorithm.
#[derive(Debug, Clone, Copy)]
pub struct NeatSettings {
    /// Of genomes in the same species.
    pub compatibility: Compatibility,
    /// Greatest distance within a species; the first one where `species` adapts it.
    pub threshold: f64,
    /// Number of species that the threshold is adapted to.
    pub species: Option<usize>,
    /// Share of each species that may have children.
    pub survival: f64,
    /// Generations without progress after which a species has no children.
    pub stagnation: u64,
    /// Share of children of one parent.
    pub mutate_only: f64,
    /// Probability that the second parent is of another species.
    pub interspecies: f64,
    /// Of weights.
    pub weights: WeightMutation,
}

#[derive(Debug, Clone)]
struct Species {
    number: u64,
    representative: Aligned,
    /// Best fitness so far, and when it was reached.
    best: f64,
    improved: u64,
}

/// A species of this generation: its members, the best first, and the children that it will have.
struct Family {
    species: Species,
    members: Vec<usize>,
    children: usize,
}

/// Species of networks that grow (Stanley and Miikkulainen, Evolutionary Computation 10, 2002).
#[derive(Debug, Clone)]
pub struct Neat {
    operators: GrowingNetwork,
    settings: NeatSettings,
    seed: u64,
    child: u64,
    represent: u64,
    generation: u64,
    /// Rows: those to be evaluated.
    population: Vec<f32>,
    species: Vec<Species>,
    founded: u64,
    threshold: f64,
    /// Species of each genome of the last `tell`.
    assigned: Vec<f64>,
}

impl Neat {
    /// `address`: seed and kind. `first`: genomes of the first generation, at least one.
    ///
    /// # Panics
    ///
    /// When these are not whole genomes.
    #[must_use]
    pub fn new(
        (seed, kind): (u64, &str),
        first: Vec<f32>,
        operators: GrowingNetwork,
        settings: NeatSettings,
    ) -> Self {
        assert!(!first.is_empty() && first.len().is_multiple_of(operators.genes()));
        Self {
            operators,
            threshold: settings.threshold,
            settings,
            seed,
            child: purpose_key(&format!("{kind}.child")),
            represent: purpose_key(&format!("{kind}.represent")),
            generation: 0,
            population: first,
            species: Vec::new(),
            founded: 0,
            assigned: Vec::new(),
        }
    }

    /// The species that a genome joins, if it does not found its own.
    fn compatible(&self, families: &[Family], aligned: &Aligned) -> Option<usize> {
        let mut nearest = (f64::INFINITY, 0);
        for (slot, family) in families.iter().enumerate() {
            let representative = &family.species.representative;
            let distance = difference(aligned, representative, self.settings.compatibility);
            if distance < self.threshold {
                return Some(slot);
            }
            if distance < nearest.0 {
                nearest = (distance, slot);
            }
        }
        (families.len() >= MOST_SPECIES).then_some(nearest.1)
    }

    /// Assigns each genome to the first species whose representative is like it, or founds one.
    fn speciate(&mut self, networks: &[Network]) -> Vec<Family> {
        let begin = |species| Family {
            species,
            members: Vec::new(),
            children: 0,
        };
        let mut families: Vec<Family> = self.species.drain(..).map(begin).collect();
        self.assigned.clear();
        for (member, network) in networks.iter().enumerate() {
            let aligned = self.operators.aligned(network);
            let slot = self.compatible(&families, &aligned).unwrap_or_else(|| {
                families.push(begin(Species {
                    number: self.founded,
                    representative: aligned.clone(),
                    best: f64::NEG_INFINITY,
                    improved: self.generation,
                }));
                self.founded += 1;
                families.len() - 1
            });
            families[slot].members.push(member);
            #[expect(clippy::cast_precision_loss, reason = "it is far below 2^53")]
            self.assigned.push(families[slot].species.number as f64);
        }
        families.retain(|family| !family.members.is_empty());
        families
    }

    /// Orders members, and notes progress of species.
    fn rank(&self, families: &mut [Family], fitness: &[f64]) {
        for family in &mut *families {
            // The first of equals is ahead; sorting is stable.
            family
                .members
                .sort_by(|first, second| descending(fitness[*first], fitness[*second]));
            let best = fitness[family.members[0]];
            if best > family.species.best {
                (family.species.best, family.species.improved) = (best, self.generation);
            }
        }
    }

    /// Decides how many children each species has: in proportion to the mean of its members' fitness, less the lowest of all if that is
    /// negative. Members that violate constraints add nothing. Species without progress have no children, unless they are the best.
    fn share(&self, families: &mut [Family], fitness: &[f64]) {
        let count = fitness.len();
        // `min` passes over those that failed (NaN).
        let feasible = fitness.iter().copied().filter(|value| *value > INFEASIBLE);
        let least = feasible.fold(0.0, f64::min);
        let mut order: Vec<usize> = (0..families.len()).collect();
        order.sort_by(|first, second| {
            let best = |family: &usize| fitness[families[*family].members[0]];
            descending(best(first), best(second))
        });
        let mut barren = vec![false; families.len()];
        for (slot, family) in order.iter().enumerate() {
            let since = self.generation - families[*family].species.improved;
            barren[*family] = slot > 0 && since >= self.settings.stagnation;
        }
        let mut shares: Vec<f64> = families
            .iter()
            .map(|family| mean(family, fitness, least))
            .collect();
        for (share, barren) in shares.iter_mut().zip(&barren) {
            *share = if *barren { 0.0 } else { *share };
        }
        if shares.iter().sum::<f64>() == 0.0 {
            // All are equal, or have failed.
            for (share, barren) in shares.iter_mut().zip(&barren) {
                *share = f64::from(u8::from(!barren));
            }
        }
        for (family, children) in families.iter_mut().zip(apportion(&shares, count)) {
            family.children = children;
        }
    }

    /// A child of a species; the address of its random numbers is its place in the generation.
    fn make(
        &self,
        families: &[Family],
        family: usize,
        (networks, fitness): (&[Network], &[f64]),
        stream: &mut Stream,
    ) -> Network {
        let NeatSettings {
            survival,
            mutate_only,
            interspecies,
            weights,
            ..
        } = self.settings;
        let parents = parents(&families[family], survival);
        let mother = parents[index(stream, parents.len())];
        let [alone, elsewhere] = std::array::from_fn(|_| stream.unit());
        let mut child = if alone < mutate_only {
            networks[mother].clone()
        } else {
            let father = if elsewhere < interspecies {
                families[index(stream, families.len())].members[0]
            } else {
                parents[index(stream, parents.len())]
            };
            // Of equally fit parents, the smaller one gives the structure.
            let genes = |member: usize| networks[member].connections();
            let order = descending(fitness[mother], fitness[father])
                .then_with(|| genes(mother).cmp(&genes(father)));
            let (fitter, other) = if order == Ordering::Greater {
                (father, mother)
            } else {
                (mother, father)
            };
            self.operators
                .cross(&networks[fitter], &networks[other], stream)
        };
        self.operators.mutate(&mut child, stream, weights);
        child
    }

    /// Fills the next population, species after species.
    fn breed(&mut self, families: &[Family], networks: &[Network], fitness: &[f64]) {
        // For each child its species, and whether it is the copy of the best member.
        let places: Vec<(usize, bool)> = families
            .iter()
            .enumerate()
            .flat_map(|(number, family)| {
                let copied = family.members.len() > LARGE;
                (0..family.children).map(move |child| (number, copied && child == 0))
            })
            .collect();
        let mut streams: Vec<Stream> = (0..places.len() as u64)
            .map(|slot| Stream::new(self.seed, self.child, self.generation, slot))
            .collect();
        let mut population = vec![0.0; self.population.len()];
        rows(
            &mut streams,
            &mut population,
            self.operators.genes(),
            |slot, stream, row| {
                let (family, is_copy) = places[slot];
                if is_copy {
                    self.operators
                        .encode(&networks[families[family].members[0]], row);
                } else {
                    let child = self.make(families, family, (networks, fitness), stream);
                    self.operators.encode(&child, row);
                }
            },
        );
        self.population = population;
    }
}

impl Search for Neat {
    fn ask(&mut self) -> Result<Vec<f32>, Unavailable> {
        Ok(self.population.clone())
    }

    fn tell(&mut self, genomes: &[f32], fitness: &[f64]) -> Result<(), Unavailable> {
        let genes = self.operators.genes();
        assert_eq!(genomes.len(), fitness.len() * genes);
        assert_eq!(genomes.len(), self.population.len());
        let networks: Vec<Network> = genomes
            .chunks_exact(genes)
            .map(|genome| self.operators.decode(genome))
            .collect();
        let mut families = self.speciate(&networks);
        self.rank(&mut families, fitness);
        self.share(&mut families, fitness);
        self.generation += 1;
        self.breed(&families, &networks, fitness);
        if let Some(target) = self.settings.species {
            match families.len().cmp(&target) {
                Ordering::Less => {
                    self.threshold = (self.threshold - THRESHOLD_STEP).max(THRESHOLD_STEP)
                }
                Ordering::Greater => self.threshold += THRESHOLD_STEP,
                Ordering::Equal => {}
            }
        }
        for family in families.into_iter().filter(|family| family.children > 0) {
            let mut species = family.species;
            let mut stream =
                Stream::new(self.seed, self.represent, self.generation, species.number);
            let member = family.members[index(&mut stream, family.members.len())];
            species.representative = self.operators.aligned(&networks[member]);
            self.species.push(species);
        }
        Ok(())
    }

    fn state(&self, name: &str) -> Option<Vec<f64>> {
        match name {
            "species" => Some(self.assigned.clone()),
            "threshold" => Some(vec![self.threshold]),
            _ => None,
        }
    }
}

/// The higher fitness first, failed ones (NaN) last.
fn descending(first: f64, second: f64) -> Ordering {
    let failed = first.is_nan().cmp(&second.is_nan());
    failed.then(second.partial_cmp(&first).unwrap_or(Ordering::Equal))
}

/// The members of a species that may have children: the best ones.
#[expect(
    clippy::cast_possible_truncation,
    clippy::cast_sign_loss,
    clippy::cast_precision_loss,
    reason = "a share of a count"
)]
fn parents(family: &Family, survival: f64) -> &[usize] {
    let count = (survival * family.members.len() as f64) as usize + 1;
    &family.members[..count.min(family.members.len())]
}

/// The mean of how far the members are above `least`; those that failed or violate constraints are at it.
#[expect(clippy::cast_precision_loss, reason = "counts are below 2^53")]
fn mean(family: &Family, fitness: &[f64], least: f64) -> f64 {
    let above = family.members.iter().map(|member| fitness[*member] - least);
    let sum: f64 = above.filter(|above| *above >= 0.0).sum();
    sum / family.members.len() as f64
}

/// Divides a number in proportion to shares: whole parts first, then one each for the largest remainders.
#[expect(
    clippy::cast_possible_truncation,
    clippy::cast_sign_loss,
    clippy::cast_precision_loss,
    reason = "parts of a count"
)]
fn apportion(shares: &[f64], count: usize) -> Vec<usize> {
    let total: f64 = shares.iter().sum();
    let exact: Vec<f64> = shares
        .iter()
        .map(|share| share / total * count as f64)
        .collect();
    let mut parts: Vec<usize> = exact.iter().map(|exact| *exact as usize).collect();
    let mut order: Vec<usize> = (0..shares.len()).collect();
    order.sort_by(|first, second| descending(exact[*first].fract(), exact[*second].fract()));
    let left = count.saturating_sub(parts.iter().sum());
    for slot in order.into_iter().cycle().take(left) {
        parts[slot] += 1;
    }
    parts
}

/// As a genetic algorithm varies genomes.
impl Operators for GrowingNetwork {
    fn genes(&self) -> usize {
        self.genes()
    }

    fn initials(&self, streams: &mut [Stream], genomes: &mut [f32]) -> Result<(), Unavailable> {
        rows(streams, genomes, self.genes(), |_, stream, genome| {
            self.initial(stream, genome);
        });
        Ok(())
    }

    fn mutations(
        &self,
        genomes: &[f32],
        parents: &[usize],
        streams: &mut [Stream],
        Variation {
            severity,
            probability,
        }: Variation,
        children: &mut [f32],
    ) -> Result<(), Unavailable> {
        let weights = WeightMutation {
            genomes: 1.0,
            each: probability,
            severity,
        };
        vary(
            self,
            (genomes, parents),
            streams,
            children,
            |parent, stream, child| {
                self.mutated(parent, stream, weights, child);
            },
        );
        Ok(())
    }

    fn matings(
        &self,
        genomes: &[f32],
        mothers: &[usize],
        partners: &[usize],
        streams: &mut [Stream],
        children: &mut [f32],
    ) -> Result<(), Unavailable> {
        let aligned =
            |member: usize| self.aligned(&self.decode(row(genomes, member, self.genes())));
        let farthest = |(): &mut (), mother: usize, partners: &[usize]| {
            let mother = aligned(mother);
            let mut farthest = (f64::NEG_INFINITY, None);
            for partner in partners {
                let distance = difference(&mother, &aligned(*partner), Compatibility::PAPER);
                if distance > farthest.0 {
                    farthest = (distance, Some(*partner));
                }
            }
            farthest.1
        };
        mate(
            self,
            genomes,
            (mothers, partners),
            streams,
            children,
            farthest,
            |[mother, father], stream, child| {
                self.crossover(mother, father, stream, child);
            },
        );
        Ok(())
    }
}
