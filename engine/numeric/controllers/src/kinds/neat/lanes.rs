//! Networks with given connections in lanes: these have no binary64, and are computed one after the other.

use swarmwright_lanes::{Lanes, MOST_LANES};

use super::{KEPT, Neat, activation, pack_output, unpack_output};
use crate::OutputRange;
use crate::kinds::LaneKind;
use crate::lanes::nodes::stretched;

impl LaneKind for Neat {
    /// As [`Kind::step`], each operation for one lane after the other.
    #[inline(always)]
    fn step_slice_in_lanes<L: Lanes>(
        &self,
        (_, genomes): (&[L], &[&[f32]]),
        state: &mut [L],
        _scratch: &mut [L],
        sensors: &[L],
        actuators: &mut [L],
    ) {
        let (mut high, mut low) = ([0.0; MOST_LANES], [0.0; MOST_LANES]);
        let mut sums = [0.0; MOST_LANES];
        for _ in 0..self.iterations {
            let mut at = 0;
            for (node, row) in self.sources.iter().enumerate() {
                let bias = at;
                sums[..L::WIDTH].fill(0.0);
                for source in row {
                    at += 1;
                    if let Some(node) = source.checked_sub(self.sensors) {
                        state[KEPT * node].store(&mut high);
                        state[KEPT * node + 1].store(&mut low);
                        for lane in 0..L::WIDTH {
                            let heard = unpack_output([high[lane], low[lane]]);
                            sums[lane] += heard * f64::from(genomes[lane][at]);
                        }
                    } else {
                        sensors[*source].store(&mut high);
                        for lane in 0..L::WIDTH {
                            sums[lane] += f64::from(high[lane]) * f64::from(genomes[lane][at]);
                        }
                    }
                }
                at += 1;
                let slope = (node >= self.hidden()).then_some(at);
                at += usize::from(slope.is_some());
                for lane in 0..L::WIDTH {
                    let genome = genomes[lane];
                    let sum = sums[lane] + f64::from(genome[bias]);
                    [high[lane], low[lane]] =
                        pack_output(activation(slope.map(|at| genome[at]), sum));
                }
                state[KEPT * node] = L::load(&high);
                state[KEPT * node + 1] = L::load(&low);
            }
        }
        let outputs = state[KEPT * self.hidden()..].chunks_exact(KEPT);
        for (actuator, parts) in actuators.iter_mut().zip(outputs) {
            parts[0].store(&mut high);
            parts[1].store(&mut low);
            for lane in 0..L::WIDTH {
                high[lane] = unpack_output([high[lane], low[lane]]) as f32;
            }
            *actuator = stretched(OutputRange::UNIT, L::load(&high));
        }
    }
}
