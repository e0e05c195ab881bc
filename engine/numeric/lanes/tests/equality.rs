//! Every instruction set computes the same bits as plain scalar arithmetic, on every kind of number.

use proptest::prelude::*;
use swarmwright_lanes::{Int, Kernel, Lanes, Level, Mask, Pair};

/// Conditions of 32 lanes.
const CONDITIONS: u32 = 0xA65C_3B91;
const COLUMNS: usize = 20;
const EIGHT: [i32; 8] = [5, -1, 0, i32::MAX, i32::MIN, 77, -8, 3];
const BYTES: [u8; 7] = [1, 0x80, 0xFF, 0, 7, 0x55, 0xAA];

/// Applies every operation to two slices of 32, with single vectors or pairs, and collects the bits.
struct All<'a> {
    numbers: [&'a [f32]; 2],
    integers: [&'a [i32]; 2],
    /// Something to transpose: more columns than a vector has lanes.
    table: &'a [[f32; COLUMNS]],
    paired: bool,
    /// Whether that is a function of its own.
    apart: bool,
}

impl Kernel for All<'_> {
    type Output = Vec<u32>;

    #[inline(always)]
    fn run<L: Lanes>(self) -> Vec<u32> {
        match (self.paired, self.apart) {
            (false, false) => self.collect::<L>(),
            (true, false) => self.collect::<Pair<L>>(),
            (false, true) => L::apart(
                #[inline(always)]
                || self.collect::<L>(),
            ),
            (true, true) => Pair::<L>::apart(
                #[inline(always)]
                || self.collect::<Pair<L>>(),
            ),
        }
    }
}

/// The sum, with every second lane by itself.
#[inline(always)]
fn by_lanes<L: Lanes>(a: L, b: L) -> L {
    let (mut sum, mut lane) = (a, 0);
    while lane < L::WIDTH {
        if lane % 2 == 1 {
            sum.numbers_mut()[lane] = a.numbers()[lane] + b.numbers()[lane];
        }
        lane += 1;
    }
    sum.add_where(b, L::Mask::from_bits(0x5555_5555))
}

impl All<'_> {
    #[inline(always)]
    fn collect<L: Lanes>(self) -> Vec<u32> {
        let ([a, b], [i, j]) = (self.numbers, self.integers);
        let mut columns: Vec<Vec<u32>> = Vec::new();
        for start in (0..32).step_by(L::WIDTH) {
            let (a, b) = (L::load(&a[start..]), L::load(&b[start..]));
            let (i, j) = (L::Int::load(&i[start..]), L::Int::load(&j[start..]));
            let small = a
                .at_most(L::splat(1000.0))
                .at_least(L::splat(-1000.0))
                .select(L::splat(0.0), a.le(a));
            let mut column = Vec::new();
            let floats = [
                a.add(b),
                a.sub(b),
                a.mul(b),
                a.div(b),
                a.sqrt(),
                a.neg(),
                a.at_most(b),
                a.at_least(b),
                a.select(b, a.lt(b)),
                a.select(b, a.le(b)),
                a.select(b, a.is_nan()),
                L::from_int(i),
                L::from_pattern(i),
                a.select(b, a.lt(b).and(i.lt(j))),
                a.select(b, a.lt(b).or(i.lt(j))),
                a.select(b, a.lt(b).and_not(i.lt(j))),
                a.select(
                    b,
                    <L::Mask as Mask>::from_bits(u64::from(CONDITIONS >> start)),
                ),
                a.add_where(b, i.lt(j)),
                by_lanes(a, b),
            ];
            let ints = [
                i.add(j),
                i.sub(j),
                i.mul(j),
                i.and(j),
                i.or(j),
                i.xor(j),
                i.shl(j.and(L::Int::splat(31))),
                i.shr(j.and(L::Int::splat(31))),
                i.shr_signed(j.and(L::Int::splat(31))),
                i.select(j, i.eq(j)),
                i.select(j, i.lt(j)),
                small.floor(),
                i.and(L::Int::splat(3)).lookup(&[7, -5, 1 << 30, 0]),
                i.and(L::Int::splat(3))
                    .lookup_where(&[7, -5, 1 << 30, 0], j, i.lt(j)),
                i.and(L::Int::splat(3)).lookup_bytes(&BYTES),
                i.and(L::Int::splat(3))
                    .lookup_bytes_where(&BYTES, j, i.lt(j)),
                i.lookup_eight(&EIGHT),
                a.at_least(b).select(b, a.le(a)).pattern(),
            ];
            let mut lanes = vec![0.0; L::WIDTH];
            for value in floats {
                value.store(&mut lanes);
                column.push(
                    lanes
                        .iter()
                        .map(|lane| {
                            if lane.is_nan() {
                                u32::MAX
                            } else {
                                lane.to_bits()
                            }
                        })
                        .collect::<Vec<_>>(),
                );
            }
            let mut lanes = vec![0; L::WIDTH];
            for value in ints {
                value.store(&mut lanes);
                column.push(lanes.iter().map(|lane| *lane as u32).collect());
            }
            let rows: Vec<&[f32]> = (start..start + L::WIDTH)
                .map(|row| &self.table[row][..])
                .collect();
            let mut columns_of_rows = [L::splat(0.0); COLUMNS - 1];
            L::transpose(&rows, 1, &mut columns_of_rows);
            for value in columns_of_rows {
                let mut lanes = vec![0.0_f32; L::WIDTH];
                value.store(&mut lanes);
                column.push(lanes.iter().map(|lane| lane.to_bits()).collect());
            }
            let bits = a.lt(b).bits();
            column.push(
                (0..L::WIDTH)
                    .map(|lane| (bits >> lane & 1) as u32)
                    .collect(),
            );
            for (index, part) in column.into_iter().enumerate() {
                if columns.len() <= index {
                    columns.push(Vec::new());
                }
                columns[index].extend(part);
            }
        }
        columns.concat()
    }
}

fn number_in_table(row: usize, column: usize) -> f32 {
    (row * COLUMNS + column) as f32
}

/// The same with one number at a time.
fn scalar(a: &[f32], b: &[f32], i: &[i32], j: &[i32]) -> Vec<u32> {
    let mut columns: Vec<Vec<u32>> = vec![Vec::new(); 37 + COLUMNS];
    for lane in 0..32 {
        let (a, b, i, j) = (a[lane], b[lane], i[lane], j[lane]);
        let choose = |condition: bool| if condition { a } else { b };
        let small = if a > 1000.0 { 1000.0 } else { a };
        let small = if small < -1000.0 { -1000.0 } else { small };
        let small = if a.is_nan() { 0.0 } else { small };
        let floats = [
            a + b,
            a - b,
            a * b,
            a / b,
            a.sqrt(),
            -a,
            if a > b { b } else { a },
            if a < b { b } else { a },
            choose(a < b),
            choose(a <= b),
            choose(a.is_nan()),
            i as f32,
            f32::from_bits(i as u32),
            choose(a < b && i < j),
            choose(a < b || i < j),
            choose(a < b && i >= j),
            choose(CONDITIONS >> lane & 1 == 1),
            if i < j { a + b } else { a },
            a + b,
        ];
        let ints = [
            i.wrapping_add(j),
            i.wrapping_sub(j),
            i.wrapping_mul(j),
            i & j,
            i | j,
            i ^ j,
            i << (j & 31),
            ((i as u32) >> (j & 31)) as i32,
            i >> (j & 31),
            if i == j { i } else { j },
            if i < j { i } else { j },
            small.floor() as i32,
            [7, -5, 1 << 30, 0][(i & 3) as usize],
            if i < j {
                [7, -5, 1 << 30, 0][(i & 3) as usize]
            } else {
                j
            },
            i32::from_le_bytes(std::array::from_fn(|byte| BYTES[(i & 3) as usize + byte])),
            if i < j {
                i32::from_le_bytes(std::array::from_fn(|byte| BYTES[(i & 3) as usize + byte]))
            } else {
                j
            },
            EIGHT[(i & 7) as usize],
            (if a < b || a.is_nan() { b } else { a }).to_bits() as i32,
        ];
        let column = floats
            .map(|value| {
                if value.is_nan() {
                    u32::MAX
                } else {
                    value.to_bits()
                }
            })
            .into_iter()
            .chain(ints.map(|value| value as u32))
            .chain((1..COLUMNS).map(|column| number_in_table(lane, column).to_bits()))
            .chain([u32::from(a < b)]);
        for (part, value) in columns.iter_mut().zip(column) {
            part.push(value);
        }
    }
    columns.concat()
}

/// Any bits: NaN, infinities, subnormals and both zeros come often enough.
fn number() -> impl Strategy<Value = f32> {
    prop_oneof![
        any::<u32>().prop_map(f32::from_bits),
        -10.0f32..10.0,
        prop::sample::select(vec![
            0.0,
            -0.0,
            f32::NAN,
            f32::INFINITY,
            f32::NEG_INFINITY,
            f32::MIN_POSITIVE / 2.0,
            1.0,
            -1.0
        ]),
    ]
}

proptest! {
    #[test]
    fn all_instruction_sets_agree_with_scalar_arithmetic(
        a in prop::collection::vec(number(), 32), b in prop::collection::vec(number(), 32),
        i in prop::collection::vec(any::<i32>(), 32), j in prop::collection::vec(any::<i32>(), 32),
    ) {
        let expected = scalar(&a, &b, &i, &j);
        let table: Vec<[f32; COLUMNS]> =
            (0..32).map(|row| std::array::from_fn(|column| number_in_table(row, column))).collect();
        for level in Level::available() {
            for (paired, apart) in [(false, false), (false, true), (true, false), (true, true)] {
                let all = All { numbers: [&a, &b], integers: [&i, &j], table: &table, paired, apart };
                prop_assert_eq!(&level.run(all), &expected, "{} {:?}", level.name(), (paired, apart));
            }
        }
        let all = All { numbers: [&a, &b], integers: [&i, &j], table: &table, paired: false, apart: false };
        prop_assert_eq!(&all.collect::<f32>(), &expected, "one lane");
    }
}

#[derive(Debug, Clone, Copy)]
enum Lookup {
    Everywhere,
    Nowhere,
    Bytes,
    NoBytes,
}

struct Outside(Lookup);
impl Kernel for Outside {
    type Output = ();
    #[inline(always)]
    fn run<L: Lanes>(self) {
        let mut out = vec![0; L::WIDTH];
        let index = L::Int::splat(4);
        let result = match self.0 {
            Lookup::Everywhere => index.lookup(&[1, 2, 3, 4]),
            Lookup::Nowhere => index.lookup_where(&[1, 2, 3, 4], index, index.lt(index)),
            Lookup::Bytes => index.lookup_bytes(&BYTES),
            Lookup::NoBytes => index.lookup_bytes_where(&BYTES, index, index.lt(index)),
        };
        result.store(&mut out);
    }
}

#[test]
fn a_lookup_outside_of_the_table_panics() {
    for level in Level::available() {
        for lookup in [
            Lookup::Everywhere,
            Lookup::Nowhere,
            Lookup::Bytes,
            Lookup::NoBytes,
        ] {
            assert!(
                std::panic::catch_unwind(|| level.run(Outside(lookup))).is_err(),
                "{} {lookup:?}",
                level.name()
            );
        }
    }
}

/// Words in rows.
struct Words<'a> {
    columns: &'a [[u64; 16]; 4],
    stride: usize,
}

impl Kernel for Words<'_> {
    type Output = Vec<u64>;

    #[inline(always)]
    fn run<L: Lanes>(self) -> Self::Output {
        let mut words = vec![7; 15 * self.stride + 4];
        L::words_of_rows(self.columns, &mut words, self.stride);
        words
    }
}

proptest! {
    #[test]
    fn words_in_rows_are_the_same_with_every_instruction_set(columns: [[u64; 16]; 4], stride in 4_usize..60) {
        let mut expected = vec![7; 15 * stride + 4];
        for (place, column) in columns.iter().enumerate() {
            for (row, word) in column.iter().enumerate() {
                expected[row * stride + place] = *word;
            }
        }
        for level in Level::available() {
            let words = level.run(Words { columns: &columns, stride });
            prop_assert_eq!(&words, &expected, "{}", level.name());
        }
    }
}
