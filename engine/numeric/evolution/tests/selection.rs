//! Who survives, who meets whom and which genomes are new, against plain forms.

use std::collections::HashSet;

use proptest::prelude::*;
use swarmwright_evolution::{
    Farthest, Ranks, Stream, Torus, Way, Ways, distance, distinct, survivors, triangular,
};

const SEED: u64 = 5;

fn stream() -> Stream {
    Stream::new(SEED, 7, 0, 0)
}

/// Fitness with equal values, both zeros and failures.
fn fitness(most: usize) -> impl Strategy<Value = Vec<f64>> {
    let value = prop_oneof![
        Just(f64::NAN),
        Just(0.0),
        Just(-0.0),
        (-3..4).prop_map(f64::from),
        any::<f64>().prop_filter("finite", |value| value.is_finite()),
        // Neighbours, which differ in their lowest bits.
        (0_u64..9).prop_map(|next| f64::from_bits(1.0_f64.to_bits() + next)),
    ];
    prop::collection::vec(value, 1..most)
}

fn ranked(fitness: &[f64]) -> Vec<usize> {
    let mut order: Vec<usize> = (0..fitness.len())
        .filter(|index| !fitness[*index].is_nan())
        .collect();
    // Adding 0.0 turns -0.0 into 0.0, which is its equal.
    order.sort_by(|left, right| (fitness[*right] + 0.0).total_cmp(&(fitness[*left] + 0.0)));
    order
}

fn genomes(count: usize, genes: usize) -> impl Strategy<Value = Vec<f32>> {
    let gene = prop_oneof![
        Just(0.0_f32),
        Just(-0.0),
        Just(1.0),
        -2.0_f32..2.0,
        Just(f32::MAX),
        Just(-f32::MAX)
    ];
    prop::collection::vec(gene, count * genes)
}

fn farthest(genome: &[f32], others: &[&[f32]]) -> Option<usize> {
    Farthest::default().find(genome, others.iter().copied())
}

fn the_first_of_largest_distance(genome: &[f32], others: &[&[f32]]) -> Option<usize> {
    let mut farthest = None;
    for (index, other) in others.iter().enumerate() {
        let its = distance(genome, other);
        if farthest.is_none_or(|(_, most)| its > most) {
            farthest = Some((index, its));
        }
    }
    farthest.map(|(index, _)| index)
}

proptest! {
    #[test]
    fn a_rank_holds_as_many_tickets_as_there_are_members_from_it_on(members in 1_u64..300) {
        let mut tickets = 0;
        for rank in 0..members {
            for _ in rank..members {
                prop_assert_eq!(triangular(tickets, members), rank);
                tickets += 1;
            }
        }
        prop_assert_eq!(tickets, members * (members + 1) / 2);
    }

    #[test]
    fn survivors_are_the_best_and_some_taken_out_of_the_rest(fitness in fitness(80), best in 0_usize..90, random in 0_usize..90) {
        let mut others = ranked(&fitness);
        let mut expected: Vec<usize> = others.drain(..best.min(others.len())).collect();
        let mut drawing = stream();
        for left in (1..=others.len() as u64).rev().take(random) {
            let place = triangular(drawing.integer(left * (left + 1) / 2), left);
            expected.push(others.remove(usize::try_from(place).unwrap()));
        }
        prop_assert_eq!(survivors(&fitness, best, random, &mut stream()), expected);
    }

    #[test]
    fn ranks_that_change_one_by_one_are_in_order(values in fitness(60), members in 1_u32..20) {
        let mut ranks = Ranks::new(members);
        let mut all = vec![f64::NAN; members as usize];
        for (turn, value) in values.iter().enumerate() {
            let place = turn * 7 % all.len();
            all[place] = *value;
            ranks.set(u32::try_from(place).unwrap(), *value);
            let order = ranked(&all);
            let worst = all.iter().rposition(|one| one.is_nan()).or(order.last().copied());
            prop_assert_eq!(ranks.worst(), worst);
            prop_assert_eq!(ranks.worked(), order.len());
            if let count @ 1.. = order.len() as u64 {
                let place = triangular(stream().integer(count * (count + 1) / 2), count);
                prop_assert_eq!(ranks.draw(&mut stream()), order[usize::try_from(place).unwrap()]);
            }
        }
    }

    #[test]
    fn genomes_are_new_once(genes in 1_usize..20, known in genomes(9, 20), found in genomes(9, 20)) {
        let whole = known.len() / genes * genes;
        let (known, rows) = (&known[..whole], &found[..whole]);
        let bits = |row: &[f32]| row.iter().map(|gene| gene.to_bits()).collect::<Vec<_>>();
        let mut seen: HashSet<_> = known.chunks(genes).map(bits).collect();
        let new: Vec<usize> = rows.chunks(genes).enumerate().filter(|(_, row)| seen.insert(bits(row))).map(|(index, _)| index).collect();
        let (one, other) = known.split_at(known.len() / genes / 2 * genes);
        prop_assert_eq!(distinct(&[one, other], rows, genes), new);
        prop_assert!(distinct(&[rows], rows, genes).is_empty());
    }

    #[test]
    fn the_farthest_has_the_largest_distance(genes in 1_usize..70, values in genomes(12, 70), wide: bool) {
        let values: Vec<f32> = values.iter().map(|gene| if wide { *gene } else { gene.clamp(-2.0, 2.0) }).collect();
        let rows: Vec<&[f32]> = values.chunks_exact(genes).collect();
        prop_assert_eq!(farthest(rows[0], &rows[1..]), the_first_of_largest_distance(rows[0], &rows[1..]));
    }

    #[test]
    fn the_farthest_is_found_where_binary32_cannot_tell(genes in 2_usize..70, row in prop::collection::vec(-2.0_f32..2.0, 70), nudged in 0_usize..9) {
        // The same numbers in other orders: in binary32 their sums differ by chance, in binary64 by the one that is a little larger.
        let rows: Vec<Vec<f32>> = (0..9).map(|turn| {
            let mut turned = row[..genes].to_vec();
            turned.rotate_left(turn % genes);
            if turn == nudged {
                turned[0] = f32::from_bits(turned[0].to_bits() + 1);
            }
            turned
        }).collect();
        let rows: Vec<&[f32]> = rows.iter().map(Vec::as_slice).collect();
        let one = vec![0.0; genes];
        prop_assert_eq!(farthest(&one, &rows), the_first_of_largest_distance(&one, &rows));
    }

    #[test]
    fn neighbourhoods_are_sorted(width in 2_usize..6, height in 2_usize..6, random: bool, empty in 0_usize..3, share in 0.0_f64..0.9, values in fitness(40)) {
        let members = width * height - empty;
        let torus = if random { Torus::random(members, SEED, share) } else { Torus::grid(width, height, empty, SEED, share) };
        let fitness: Vec<f64> = values.iter().copied().cycle().take(members).collect();
        prop_assert_eq!(torus.members(), members);
        for member in 0..members {
            let near = torus.neighbours(member);
            prop_assert!(near.len() <= 8 && near.is_sorted_by(|one, other| one < other));
            prop_assert!(near.iter().all(|other| *other as usize != member && (*other as usize) < members));
            let mut all: Vec<u32> = near.iter().copied().chain([u32::try_from(member).unwrap()]).collect();
            #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, clippy::cast_precision_loss)]
            let size = (all.len() as f64 * share).round_ties_even() as usize;
            all.retain(|one| !fitness[*one as usize].is_nan());
            all.sort_by(|one, other| {
                fitness[*other as usize].partial_cmp(&fitness[*one as usize]).unwrap().then(other.cmp(one))
            });
            let elite: Vec<usize> = all.iter().take(size).map(|one| *one as usize).collect();
            let stays = elite.contains(&member);
            prop_assert_eq!(torus.elite(&fitness, member), elite);
            let ways = Ways { mutate: 0.0, crossover: 1.0 };
            let parents = if size > 0 { size.min(all.len()) } else { all.len() };
            for (rank, parent) in all[..parents].iter().enumerate() {
                #[expect(clippy::cast_precision_loss)]
                let place = (rank as f64 + 0.5) / parents as f64;
                let parent = *parent as usize;
                let way = if fitness[member].is_nan() { Way::Mutate(parent) } else { Way::Cross(parent) };
                prop_assert_eq!(torus.choose(&fitness, member, ways, [0.0, place]), way);
            }
            prop_assert_eq!(torus.stays(&fitness, member), stays);
        }
        let next = |cursor| (0..members).map(|step| (cursor + step) % members).find(|member| !torus.stays(&fitness, *member));
        for cursor in 0..members {
            prop_assert_eq!(torus.next(&fitness, cursor), next(cursor));
        }
    }
}

#[test]
fn a_torus_is_closed() {
    let torus = Torus::grid(4, 3, 0, SEED, 0.11);
    // Columns of three cells: 0 1 2, 3 4 5, 6 7 8, 9 10 11.
    assert_eq!(torus.neighbours(0), [1, 2, 3, 4, 5, 9, 10, 11]);
    assert_eq!(torus.neighbours(7), [3, 4, 5, 6, 8, 9, 10, 11]);
    assert_eq!(Torus::grid(2, 2, 0, SEED, 0.11).neighbours(3), [0, 1, 2]);
}

#[test]
fn members_are_made_in_the_ways_that_tickets_say() {
    let torus = Torus::grid(3, 3, 0, SEED, 0.2);
    let ways = Ways {
        mutate: 0.4,
        crossover: 0.2,
    };
    let mut fitness = [0.0, 1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0, 8.0];
    // Two of nine stay, 8 and 7; tickets below 0.8 times 0.5, 0.75 and 1 mutate, cross and renew.
    for (ticket, place, way) in [
        (0.0, 0.0, Way::Mutate(8)),
        (0.49, 0.51, Way::Mutate(7)),
        (0.51, 0.49, Way::Cross(8)),
        (0.74, 0.99, Way::Cross(7)),
        (0.76, 0.0, Way::Renew),
    ] {
        assert_eq!(torus.choose(&fitness, 2, ways, [ticket, place]), way);
    }
    fitness[2] = f64::NAN;
    assert_eq!(
        torus.choose(&fitness, 2, ways, [0.6, 0.0]),
        Way::Mutate(8),
        "one that failed is not a parent"
    );
    let failed = [f64::NAN; 9];
    assert_eq!(torus.choose(&failed, 2, ways, [0.0, 0.0]), Way::Renew);
    let none_stays = Torus::grid(3, 3, 0, SEED, 0.0);
    assert_eq!(
        none_stays.choose(&fitness, 4, ways, [0.0, 0.0]),
        Way::Mutate(4),
        "its own member"
    );
}
