//! From all crossings of a texel's ray to a few layers (Section 5.1; Lokovic and Veach 2000).
//!
//! Visibility falls at every crossing. Runs of crossings become one layer as long as a straight line
//! between its ends stays within an error bound of the visibility at all of them; the number of crossings is kept.
//! Opaque surfaces are never merged. Once visibility has fallen to nothing it starts from 1 again, a chosen
//! number of times. If the layers are too few, the bound is doubled until they do; what is still too much is
//! left out from behind.
//!
//! Where the paper spreads a layer's samples over all of the depth since the layer before, a layer here
//! keeps where its first sample lies, so that gaps between objects stay free. A layer of one crossing
//! is the surface itself; one of several has their mean slope.

use super::map::{Medium, Piece};

/// The error bound that follows a bound of 0, half of an 8-bit step.
const LEAST_ERROR: f32 = 1.0 / 512.0;

/// A surface that a texel's ray crosses, and its transmittance.
#[derive(Debug, Clone, Copy)]
pub struct Crossing {
    /// The surface.
    pub piece: Piece,
    /// 0 if it is opaque.
    pub through: f32,
}

/// How crossings are compressed.
#[derive(Debug, Clone, Copy)]
pub struct Compression {
    /// Largest error of visibility.
    pub error: f32,
    /// Visibility that counts as none.
    pub threshold: f32,
    /// How often visibility starts again.
    pub resets: usize,
}

/// Compresses `crossings`, the nearest first, to at most `layers` layers, which replace what is in `out`.
pub fn compress(
    crossings: &[Crossing],
    layers: usize,
    how: &Compression,
    out: &mut Vec<(Piece, Medium)>,
) {
    // What fits needs no compression.
    let mut error = if crossings.len() > layers {
        how.error
    } else {
        -1.0
    };
    loop {
        once(crossings, error, how, out);
        // With a bound of 1 all between two opaque surfaces is one layer.
        if out.len() <= layers || error >= 1.0 {
            out.truncate(layers);
            return;
        }
        error = (2.0 * error).max(LEAST_ERROR);
    }
}

fn once(crossings: &[Crossing], error: f32, how: &Compression, out: &mut Vec<(Piece, Medium)>) {
    out.clear();
    let (mut visibility, mut resets, mut at) = (1.0f32, 0, 0);
    while at < crossings.len() {
        let (count, behind) = run(&crossings[at..], visibility, error, how.threshold);
        let (first, last) = (&crossings[at], &crossings[at + count - 1]);
        let through = if count == 1 {
            first.through
        } else {
            (behind / visibility).powf(1.0 / count as f32)
        };
        let piece = if count == 1 {
            last.piece
        } else {
            let slopes = crossings[at..at + count].iter().map(|c| c.piece.slope());
            let sum = slopes.fold([0.0; 2], |[x, y], s| [x + s[0], y + s[1]]);
            Piece::new(last.piece.inverse_depth, sum.map(|s| s / count as f32))
        };
        out.push((
            piece,
            Medium {
                first: first.piece.inverse_depth,
                visibility: behind,
                through,
                count: count as u32,
            },
        ));
        visibility = behind;
        at += count;
        if visibility <= how.threshold {
            if resets == how.resets {
                return;
            }
            (visibility, resets) = (1.0, resets + 1);
        }
    }
}

/// How many of the crossings one layer stands for, and the visibility behind it; one if `error` is negative.
fn run(crossings: &[Crossing], before: f32, error: f32, threshold: f32) -> (usize, f32) {
    let start = crossings[0].piece.inverse_depth;
    let mut visibility = before * crossings[0].through;
    if visibility <= threshold || error < 0.0 {
        return (1, visibility);
    }
    let (mut best, mut behind) = (1, visibility);
    // Slopes, over the depth since the first crossing, of lines that pass all crossings so far close enough.
    let (mut low, mut high) = (f32::NEG_INFINITY, f32::INFINITY);
    for (i, crossing) in crossings.iter().enumerate().skip(1) {
        if crossing.through == 0.0 {
            break;
        }
        let before_it = visibility;
        visibility *= crossing.through;
        let depth = start - crossing.piece.inverse_depth;
        // On the way to this crossing the line is off by what visibility falls there, too.
        let ends = [before_it, visibility].map(|v| v - before);
        if depth > 0.0 {
            let slope = ends[1] / depth;
            if slope >= low && slope <= high {
                (best, behind) = (i + 1, visibility);
            }
            let step = ends[0] - ends[1];
            low = low.max((ends[1] - error) / depth);
            high = high.min((ends[1] + error + step) / depth);
            if low > high {
                break;
            }
        } else {
            // At the same depth: they are one.
            (best, behind) = (i + 1, visibility);
        }
        if visibility <= threshold {
            break;
        }
    }
    (best, behind)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn crossings(list: &[(f32, f32)]) -> Vec<Crossing> {
        list.iter()
            .map(|&(w, through)| Crossing {
                piece: Piece::new(w, [0.0; 2]),
                through,
            })
            .collect()
    }

    fn compressed(list: &[(f32, f32)], layers: usize, error: f32) -> Vec<(Piece, Medium)> {
        let how = Compression {
            error,
            threshold: 1e-3,
            resets: 8,
        };
        let mut out = Vec::new();
        compress(&crossings(list), layers, &how, &mut out);
        out
    }

    #[test]
    fn without_error_every_surface_is_a_layer() {
        let out = compressed(&[(0.9, 0.5), (0.7, 0.5), (0.2, 0.9)], 8, 0.0);
        assert_eq!(out.len(), 3);
        assert!(out.iter().all(|(_, m)| m.count == 1));
        let last = out[2].1.visibility;
        assert!((last - 0.225).abs() < 1e-6);
    }

    #[test]
    fn an_even_medium_is_one_layer_with_all_its_surfaces() {
        let list: Vec<_> = (0..1000).map(|i| (0.9 - 1e-4 * i as f32, 0.9995)).collect();
        let out = compressed(&list, 5, 0.02);
        assert!(out.len() <= 5);
        let count: u32 = out.iter().map(|(_, m)| m.count).sum();
        assert_eq!(count, 1000);
        let product: f32 = out
            .iter()
            .map(|(_, m)| m.through.powi(m.count as i32))
            .product();
        assert!((product - 0.9995f32.powi(1000)).abs() < 1e-3);
    }

    #[test]
    fn opaque_surfaces_stay_apart_and_visibility_starts_again_behind_them() {
        let list = [(0.9, 0.5), (0.8, 0.0), (0.7, 0.0), (0.6, 0.5), (0.5, 0.5)];
        let out = compressed(&list, 4, 1.0);
        let kept: Vec<_> = out.iter().map(|(_, m)| (m.count, m.visibility)).collect();
        assert_eq!(kept, [(1, 0.5), (1, 0.0), (1, 0.0), (2, 0.25)]);
        // What does not fit is left out from behind.
        assert_eq!(compressed(&list, 2, 1.0).len(), 2);
    }
}
