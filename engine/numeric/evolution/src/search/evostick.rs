//! The evolutionary algorithm of EvoStick: a few best genomes stay, the others are their mutants.

use super::{Search, Unavailable};
use crate::stream::{Stream, purpose_key, rows};
use crate::swarm::rounded;

/// Probability that a gene is moved, and that it is drawn anew.
type Chances = (f64, f64);

/// Of a genome that is changed less, and of its last fifth if it is long.
const EVERY_GENE: Chances = (1.0, 0.0);
const LAST_FIFTH: Chances = (0.5, 0.2);
/// Of a genome that is changed more: every second one.
const SEVERE: Chances = (0.7, 0.2);
/// Smallest number of genes of a genome with a last fifth.
const LONG: usize = 10;

/// Settings of the algorithm, gene by gene.
#[derive(Debug, Clone)]
pub struct EvostickSettings {
    /// Genomes that stay.
    pub elites: usize,
    /// Genes are drawn anew around it.
    pub middle: Vec<f64>,
    /// How far a gene is moved at most, and drawn from the middle.
    pub step: Vec<f64>,
    /// Lowest value.
    pub lower: Vec<f64>,
    /// Highest value.
    pub upper: Vec<f64>,
}

/// A population of which the best are evaluated again in each generation, along with mutants of them (Francesca et al.,
/// Swarm Intelligence 8, 2014). Mutation is that of the weights in NEAT (Stanley and Miikkulainen, Evolutionary
/// Computation 10, 2002), where it was taken from.
#[derive(Debug, Clone)]
pub struct Evostick {
    settings: EvostickSettings,
    seed: u64,
    purpose: u64,
    generation: u64,
    /// Rows: those to be evaluated.
    population: Vec<f32>,
}

impl Evostick {
    /// `address`: seed and kind. `first`: genomes of the first generation, at least as many as stay.
    ///
    /// # Panics
    ///
    /// When lengths do not fit together.
    #[must_use]
    pub fn new((seed, kind): (u64, &str), first: Vec<f32>, settings: EvostickSettings) -> Self {
        let genes = settings.middle.len();
        assert!(genes > 0 && first.len().is_multiple_of(genes));
        assert!((1..=first.len() / genes).contains(&settings.elites));
        for numbers in [&settings.step, &settings.lower, &settings.upper] {
            assert_eq!(numbers.len(), genes);
        }
        Self {
            settings,
            seed,
            purpose: purpose_key(&format!("{kind}.candidate")),
            generation: 0,
            population: first,
        }
    }

    /// A mutant of one of the best: which one is drawn first, then how much is changed, then for each gene whether, and how far.
    fn mutate(&self, best: &[f32], stream: &mut Stream, genes: &mut [f64], mutant: &mut [f32]) {
        let EvostickSettings {
            elites,
            middle,
            step,
            lower,
            upper,
        } = &self.settings;
        let count = genes.len();
        let parent = usize::try_from(stream.integer(*elites as u64)).unwrap_or_default();
        let severe = stream.unit() < 0.5;
        for (gene, value) in genes.iter_mut().enumerate() {
            let last = count >= LONG && 5 * gene > 4 * count;
            let (moved, anew) = match (severe, last) {
                (true, _) => SEVERE,
                (false, true) => LAST_FIFTH,
                (false, false) => EVERY_GENE,
            };
            let chance = stream.unit();
            let change = stream.uniform(step[gene]);
            let before = f64::from(best[parent * count + gene]);
            *value = if chance < moved {
                before + change
            } else if chance < moved + anew {
                middle[gene] + change
            } else {
                before
            };
        }
        rounded(genes, lower, upper, mutant);
    }
}

impl Search for Evostick {
    fn ask(&mut self) -> Result<Vec<f32>, Unavailable> {
        Ok(self.population.clone())
    }

    fn tell(&mut self, genomes: &[f32], fitness: &[f64]) -> Result<(), Unavailable> {
        let genes = self.settings.middle.len();
        assert_eq!(genomes.len(), fitness.len() * genes);
        assert_eq!(genomes.len(), self.population.len());
        let mut order: Vec<usize> = (0..fitness.len()).collect();
        // The first of equals is the better one; a failed one is the worst.
        order.sort_by(|first, second| {
            let key = |index: usize| (fitness[index].is_nan(), -fitness[index]);
            let ((first_failed, first_cost), (second_failed, second_cost)) =
                (key(*first), key(*second));
            first_failed.cmp(&second_failed).then(
                first_cost
                    .partial_cmp(&second_cost)
                    .unwrap_or(std::cmp::Ordering::Equal),
            )
        });
        let best: Vec<f32> = order[..self.settings.elites]
            .iter()
            .flat_map(|index| &genomes[index * genes..(index + 1) * genes])
            .copied()
            .collect();
        self.generation += 1;
        let mut population = best.clone();
        population.resize(genomes.len(), 0.0);
        let candidates = self.settings.elites as u64..fitness.len() as u64;
        let mut streams: Vec<Stream> = candidates
            .map(|index| Stream::new(self.seed, self.purpose, self.generation, index))
            .collect();
        rows(
            &mut streams,
            &mut population[best.len()..],
            genes,
            |_, stream, mutant| self.mutate(&best, stream, &mut vec![0.0; genes], mutant),
        );
        self.population = population;
        Ok(())
    }

    fn state(&self, _name: &str) -> Option<Vec<f64>> {
        None
    }
}
