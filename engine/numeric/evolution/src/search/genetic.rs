//! A genetic algorithm for genomes of any kind: survivor selection, mutation and crossover.

use std::ops::Range;

use super::{Members, Search, Unavailable};
use crate::distance::Farthest;
use crate::distinct::distinct;
use crate::network::NodeNetwork;
use crate::ranking::survivors;
use crate::stream::{Stream, purpose_key, rows, rows_of_two};

/// Crossovers that a generation may repeat because the child exists already.
const TRIALS: usize = 100;
/// Genes that are made in little more time than another thread takes to begin.
const FEW: usize = 1 << 14;

/// How genomes come about, vary, and combine.
pub trait Operators: Send + Sync {
    /// Genes of a genome.
    fn genes(&self) -> usize;

    /// A random genome for each stream.
    ///
    /// # Errors
    /// A function of the caller that makes them has failed.
    fn initials(&self, streams: &mut [Stream], genomes: &mut [f32]) -> Result<(), Unavailable>;

    /// A copy of a parent for each stream, varied; `parents`: by index among `genomes`.
    ///
    /// # Errors
    /// As of [`initials`](Self::initials).
    fn mutations(
        &self,
        genomes: &[f32],
        parents: &[usize],
        streams: &mut [Stream],
        mutation: Variation,
        children: &mut [f32],
    ) -> Result<(), Unavailable>;

    /// A child of each mother and of the most different one of its partners, with a stream for each.
    ///
    /// `mothers`, `partners`: by index among `genomes`; as many partners for each mother.
    ///
    /// # Errors
    /// As of [`initials`](Self::initials).
    fn matings(
        &self,
        genomes: &[f32],
        mothers: &[usize],
        partners: &[usize],
        streams: &mut [Stream],
        children: &mut [f32],
    ) -> Result<(), Unavailable>;
}

/// How much a mutation changes.
#[derive(Debug, Clone, Copy)]
pub struct Variation {
    /// Size of changes.
    pub severity: f64,
    /// Probability of a gene to be changed.
    pub probability: f64,
}

impl Operators for NodeNetwork {
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
        vary(
            self,
            (genomes, parents),
            streams,
            children,
            |parent, stream, child| {
                self.mutate(parent, stream, severity, probability, child);
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
        let genome = |member: &usize| row(genomes, *member, self.genes());
        let farthest = |farthest: &mut Farthest, mother: usize, partners: &[usize]| {
            let index = farthest.find(genome(&mother), partners.iter().map(genome));
            index.map(|index| partners[index])
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

/// Makes a child of a parent for each stream; the arguments are those of [`Operators::mutations`].
pub(super) fn vary(
    operators: &impl Operators,
    (genomes, parents): (&[f32], &[usize]),
    streams: &mut [Stream],
    children: &mut [f32],
    make: impl Fn(&[f32], &mut Stream, &mut [f32]) + Sync,
) {
    let genes = operators.genes();
    rows(streams, children, genes, |index, stream, child| {
        make(row(genomes, parents[index], genes), stream, child);
    });
}

/// Makes a child of each mother and of the partner that `farthest` finds, or of the mother alone; the arguments are those of
/// [`Operators::matings`].
pub(super) fn mate<R: Default>(
    operators: &impl Operators,
    genomes: &[f32],
    (mothers, partners): (&[usize], &[usize]),
    streams: &mut [Stream],
    children: &mut [f32],
    farthest: impl Fn(&mut R, usize, &[usize]) -> Option<usize> + Sync,
    cross: impl Fn([&[f32]; 2], &mut Stream, &mut [f32]) + Sync,
) {
    let (genes, columns) = (operators.genes(), partners.len() / mothers.len().max(1));
    let make =
        |scratch: &mut R, index: usize, stream: &mut Stream, child: &mut [f32], _: &mut [()]| {
            let mother = mothers[index];
            let father = farthest(scratch, mother, &partners[index * columns..][..columns]);
            let parents = [mother, father.unwrap_or(mother)];
            cross(
                parents.map(|member| row(genomes, member, genes)),
                stream,
                child,
            );
        };
    let mut none = vec![(); children.len()];
    rows_of_two(streams, (children, &mut none), genes, FEW, R::default, make);
}

/// The settings of a [`Genetic`].
#[derive(Debug, Clone, Copy)]
pub struct GeneticSettings {
    /// Populations that evolve side by side, and members of each.
    pub populations: usize,
    /// At least as many as `elite`, `random`, `mutate` and `crossover` together.
    pub members: usize,
    /// Best members that stay.
    pub elite: usize,
    /// Others that stay, better ones more often.
    pub random: usize,
    /// Varied copies of those that stay.
    pub mutate: usize,
    /// Children of two that stay.
    pub crossover: usize,
    /// Of mutations.
    pub variation: Variation,
    /// Partners drawn for each crossover, at least one.
    pub partners: usize,
    /// Generations from one exchange between populations to the next; 0: there is none.
    pub exchange_interval: u64,
    /// Share of crossovers whose partners come from any population then.
    pub exchange: f64,
}

/// Survival, mutation, crossover and renewal, see `swarmwright.methods.nnga`.
pub struct Genetic {
    settings: GeneticSettings,
    operators: Box<dyn Operators>,
    seed: u64,
    purposes: Purposes,
    generation: u64,
    /// The first generation, until it is asked for.
    first: Vec<f32>,
    /// Those of one population after the other.
    genomes: Vec<f32>,
    fitness: Vec<f64>,
    /// Number of members of each population, and of requested new ones.
    counts: Vec<usize>,
    children: Vec<usize>,
}

struct Purposes {
    survive: u64,
    mutate: u64,
    crossover: u64,
    exchange: u64,
    initial: u64,
}

impl Genetic {
    /// `address`: seed and kind. `first`: genomes of the first generation.
    ///
    /// # Panics
    ///
    /// When there are not as many genomes as members, or more ways to a member than members.
    #[must_use]
    pub fn new(
        (seed, kind): (u64, &str),
        first: Vec<f32>,
        settings: GeneticSettings,
        operators: Box<dyn Operators>,
    ) -> Self {
        let all = settings.populations * settings.members;
        assert_eq!(first.len(), all * operators.genes());
        let shares = [
            settings.elite,
            settings.random,
            settings.mutate,
            settings.crossover,
        ];
        assert!(shares.iter().sum::<usize>() <= settings.members);
        assert!(settings.partners > 0);
        let key = |purpose| purpose_key(&format!("{kind}.{purpose}"));
        Self {
            operators,
            seed,
            purposes: Purposes {
                survive: key("survive"),
                mutate: key("mutate"),
                crossover: key("crossover"),
                exchange: key("exchange"),
                initial: purpose_key("initial"),
            },
            generation: 0,
            first,
            genomes: Vec::new(),
            fitness: Vec::new(),
            counts: vec![0; settings.populations],
            children: vec![settings.members; settings.populations],
            settings,
        }
    }

    fn stream(&self, purpose: u64, candidate: usize) -> Stream {
        Stream::new(self.seed, purpose, self.generation, candidate as u64)
    }

    fn streams(&self, purpose: u64, candidates: Range<usize>) -> Vec<Stream> {
        let candidates = candidates.start as u64..candidates.end as u64;
        Stream::of_each(self.seed, purpose, self.generation, candidates)
    }

    /// Drops all members but those that stay, in every population.
    fn select(&mut self) {
        let (genes, settings) = (self.operators.genes(), self.settings);
        let before = (
            std::mem::take(&mut self.genomes),
            std::mem::take(&mut self.fitness),
        );
        self.genomes.reserve(before.0.len()); // with capacity for the children that are added
        self.fitness.reserve(before.1.len());
        let mut first = 0;
        for number in 0..settings.populations {
            let its = first..first + self.counts[number];
            first = its.end;
            let mut stream = self.stream(self.purposes.survive, number);
            let fitness = &before.1[its.clone()];
            let staying = survivors(fitness, settings.elite, settings.random, &mut stream);
            self.counts[number] = staying.len();
            for member in staying {
                let member = its.start + member;
                self.genomes
                    .extend_from_slice(row(&before.0, member, genes));
                self.fitness.push(before.1[member]);
            }
        }
    }

    /// Range of the members of each population.
    fn places(&self) -> Vec<Range<usize>> {
        let mut first = 0;
        let range_of = |count: &usize| {
            let range = first..first + count;
            first = range.end;
            range
        };
        self.counts.iter().map(range_of).collect()
    }

    /// Adds the new members of a population to `pool`.
    fn make(
        &self,
        number: usize,
        places: &[Range<usize>],
        pool: &mut Vec<f32>,
    ) -> Result<(), Unavailable> {
        let genes = self.operators.genes();
        let begin = pool.len() / genes;
        if !places[number].is_empty() {
            self.mutate(begin, &places[number], pool)?;
            self.cross(number, places, begin, pool)?;
        }
        let next = pool.len() / genes;
        let last = begin + self.settings.members - places[number].len();
        if next < last {
            let mut streams = self.streams(self.purposes.initial, next..last);
            pool.resize(last * genes, 0.0);
            let genomes = &mut pool[next * genes..];
            self.operators.initials(&mut streams, genomes)?;
        }
        Ok(())
    }

    fn mutate(
        &self,
        begin: usize,
        members: &Range<usize>,
        pool: &mut Vec<f32>,
    ) -> Result<(), Unavailable> {
        let (genes, count) = (self.operators.genes(), self.settings.mutate);
        if count == 0 {
            return Ok(());
        }
        let mut streams = self.streams(self.purposes.mutate, begin..begin + count);
        let parents: Vec<_> = streams
            .iter_mut()
            .map(|stream| drawn(stream, members))
            .collect();
        pool.resize((begin + count) * genes, 0.0);
        self.operators.mutations(
            &self.genomes,
            &parents,
            &mut streams,
            self.settings.variation,
            &mut pool[begin * genes..],
        )
    }

    /// Adds children of two that are all different from each other, from the members, and from those made since `begin`.
    fn cross(
        &self,
        number: usize,
        places: &[Range<usize>],
        begin: usize,
        pool: &mut Vec<f32>,
    ) -> Result<(), Unavailable> {
        let genes = self.operators.genes();
        let members = &self.genomes[places[number].start * genes..places[number].end * genes];
        let most = self.settings.crossover + TRIALS;
        let (mut missing, mut trial) = (self.settings.crossover, 0);
        while missing > 0 && trial < most {
            let last = (trial + missing).min(most);
            let first = pool.len();
            pool.resize(first + (last - trial) * genes, 0.0);
            let (existing, children) = pool.split_at_mut(first);
            let addresses = number * most + trial..number * most + last;
            self.crossovers(number, places, addresses, children)?;
            let new = distinct(&[members, &existing[begin * genes..]], children, genes);
            for (index, child) in new.iter().enumerate() {
                if index < *child {
                    children.copy_within(child * genes..(child + 1) * genes, index * genes);
                }
            }
            pool.truncate(first + new.len() * genes);
            missing -= new.len();
            trial = last;
        }
        Ok(())
    }

    #[expect(
        clippy::cast_possible_truncation,
        reason = "drawn numbers are below a usize"
    )]
    fn crossovers(
        &self,
        number: usize,
        places: &[Range<usize>],
        addresses: Range<usize>,
        children: &mut [f32],
    ) -> Result<(), Unavailable> {
        let peopled: Vec<_> = places.iter().filter(|range| !range.is_empty()).collect();
        let mut streams = self.streams(self.purposes.crossover, addresses.clone());
        let mut mothers = Vec::with_capacity(streams.len());
        let mut partners = Vec::with_capacity(streams.len() * self.settings.partners);
        let mut drawn_partners = vec![0; self.settings.partners];
        let exchanging = self.is_exchanging();
        for (address, stream) in addresses.zip(&mut streams) {
            mothers.push(drawn(stream, &places[number]));
            let mut home = &places[number];
            if exchanging {
                let mut exchange = self.stream(self.purposes.exchange, address);
                let other = peopled[drawn(&mut exchange, &(0..peopled.len()))];
                if exchange.unit() < self.settings.exchange {
                    home = other;
                }
            }
            stream.integers(home.len() as u64, &mut drawn_partners);
            let placed = |drawn: &u64| home.start + *drawn as usize;
            partners.extend(drawn_partners.iter().map(placed));
        }
        self.operators
            .matings(&self.genomes, &mothers, &partners, &mut streams, children)
    }

    fn is_exchanging(&self) -> bool {
        let interval = self.settings.exchange_interval;
        self.settings.populations > 1
            && interval > 0
            && (self.generation - 1).is_multiple_of(interval)
    }
}

impl Search for Genetic {
    fn ask(&mut self) -> Result<Vec<f32>, Unavailable> {
        if self.generation == 0 {
            return Ok(std::mem::take(&mut self.first));
        }
        self.select();
        let places = self.places();
        let all = self.settings.populations * self.settings.members;
        let genes = self.operators.genes();
        let mut pool = Vec::with_capacity((all - self.fitness.len()) * genes);
        for (number, range) in places.iter().enumerate() {
            self.make(number, &places, &mut pool)?;
            self.children[number] = self.settings.members - range.len();
        }
        Ok(pool)
    }

    fn tell(&mut self, genomes: &[f32], fitness: &[f64]) -> Result<(), Unavailable> {
        let genes = self.operators.genes();
        assert_eq!(fitness.len(), self.children.iter().sum::<usize>());
        assert_eq!(genomes.len(), fitness.len() * genes);
        if self.settings.populations == 1 {
            self.genomes.extend_from_slice(genomes);
            self.fitness.extend_from_slice(fitness);
        } else {
            let all = self.settings.populations * self.settings.members;
            let (mut joined, mut values) =
                (Vec::with_capacity(all * genes), Vec::with_capacity(all));
            let mut first = 0;
            for (range, children) in self.places().into_iter().zip(&self.children) {
                let new = first..first + children;
                first = new.end;
                joined.extend_from_slice(&self.genomes[range.start * genes..range.end * genes]);
                joined.extend_from_slice(&genomes[new.start * genes..new.end * genes]);
                values.extend_from_slice(&self.fitness[range]);
                values.extend_from_slice(&fitness[new]);
            }
            (self.genomes, self.fitness) = (joined, values);
        }
        for (count, children) in self.counts.iter_mut().zip(&self.children) {
            *count += children;
        }
        self.generation += 1;
        Ok(())
    }

    fn members(&self) -> Option<Members<'_>> {
        Some(Members {
            genomes: &self.genomes,
            fitness: &self.fitness,
        })
    }

    fn rescore(&mut self, fitness: &[f64]) {
        self.fitness = fitness.to_vec();
    }

    fn state(&self, _name: &str) -> Option<Vec<f64>> {
        None
    }
}

pub(super) fn row(genomes: &[f32], index: usize, genes: usize) -> &[f32] {
    &genomes[index * genes..(index + 1) * genes]
}

/// One of these indices, all equally likely.
#[expect(
    clippy::cast_possible_truncation,
    reason = "it is below the end of the range"
)]
fn drawn(stream: &mut Stream, from: &Range<usize>) -> usize {
    from.start + stream.integer(from.len() as u64) as usize
}
