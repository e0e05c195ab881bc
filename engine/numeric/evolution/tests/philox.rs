//! The published answers of Philox, and streams against their definition.

use proptest::prelude::*;
use swarmwright_evolution::{Stream, philox, purpose_key};

#[test]
fn words_are_the_published_ones() {
    // Known answers of Random123: all bits 0, all bits 1.
    assert_eq!(
        philox([0; 4], [0; 2]),
        [
            0x1655_4D9E_CA36_314C,
            0xDB20_FE9D_672D_0FDC,
            0xD7E7_72CE_E186_176B,
            0x7E68_B68A_EC7B_A23B,
        ]
    );
    assert_eq!(
        philox([u64::MAX; 4], [u64::MAX; 2]),
        [
            0x87B0_92C3_013F_E90B,
            0x438C_3C67_BE8D_0224,
            0x9CC7_D7C6_9CD7_77B6,
            0xA09C_AEBF_594F_0BA0,
        ]
    );
}

#[test]
fn a_purpose_is_known_by_its_sha_256() {
    // The SHA-256 of nothing begins with e3b0c44298fc1c14.
    assert_eq!(purpose_key(""), 0x141C_FC98_42C4_B0E3);
}

proptest! {
    #[test]
    fn streams_are_blocks_from_1_on(seed: u64, purpose: u64, generation: u64, candidate: u64) {
        let expected: Vec<u64> = (1..=3)
            .flat_map(|block| philox([block, candidate, generation, 0], [seed, purpose]))
            .collect();
        let mut words = [0; 12];
        Stream::new(seed, purpose, generation, candidate).fill(&mut words);
        prop_assert_eq!(words.to_vec(), expected);
    }

    #[test]
    fn in_parts_and_with_gaps_the_words_are_the_same(parts in prop::collection::vec((prop_oneof![0_usize..9, 0_usize..200], 0_u8..3), 1..20)) {
        let mut stream = Stream::new(1, 2, 3, 4);
        let mut whole = vec![0; parts.iter().map(|(count, _)| count).sum()];
        stream.clone().fill(&mut whole);
        let mut rest = whole.as_slice();
        for (count, way) in parts {
            let (expected, others) = rest.split_at(count);
            rest = others;
            let mut words = vec![0; count];
            match way {
                0 => stream.fill(&mut words),
                1 => words.fill_with(|| stream.word()),
                _ => { stream.skip(count); continue; }
            }
            prop_assert_eq!(words.as_slice(), expected);
        }
    }

    #[test]
    fn integers_stay_below(seed: u64, below in 1_u64..) {
        let mut stream = Stream::new(seed, 0, 0, 0);
        prop_assert!((0..20).all(|_| stream.integer(below) < below));
    }
}
