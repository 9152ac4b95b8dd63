//! The left–right test: does the right image choose the same pair?

use crate::kernels::sad::{Choice, Cost};

/// Columns at a time: gathered one by one, compared in vectors.
const CHUNK: usize = 64;

/// Adds `bit` where the right pixel's smallest cost does not occur near the left pixel's disparity.
///
/// `right_best[x + chosen[x].lane]` is the smallest cost of the right pixel opposite column `x`, over all its candidates;
/// `nearby[x]` the smallest of those whose disparity is close enough to the one chosen. If they agree, so does the right
/// image. Unlike a comparison of the two images' chosen disparities, ties need no rule. Columns whose bits have some of
/// `except` are left alone.
pub(super) fn mark<C: Cost>(
    chosen: &[Choice<C>],
    nearby: &[C],
    right_best: &[C],
    bit: u8,
    except: u8,
    bits: &mut [u8],
) {
    let columns = chosen.chunks(CHUNK).zip(nearby.chunks(CHUNK)).zip(bits.chunks_mut(CHUNK));
    for (i, ((chosen, nearby), bits)) in columns.enumerate() {
        let mut opposite = [C::ZERO; CHUNK];
        for ((opposite, choice), x) in opposite.iter_mut().zip(chosen).zip(i * CHUNK..) {
            *opposite = right_best[x + choice.lane.to_u32() as usize];
        }
        for ((bits, &opposite), &nearby) in bits.iter_mut().zip(&opposite).zip(nearby) {
            let disagrees = (opposite < nearby) & (*bits & except == 0);
            *bits |= if disagrees { bit } else { 0 };
        }
    }
}
