//! Convolution of pictures by the fast Fourier transform.

use rayon::prelude::*;
use rustfft::num_complex::Complex;
use rustfft::{Fft, FftPlannerScalar};
use std::sync::Arc;

type Number = Complex<f32>;

/// Transforms of pictures of one size.
pub struct Transform {
    width: usize,
    height: usize,
    rows: [Arc<dyn Fft<f32>>; 2],
    columns: [Arc<dyn Fft<f32>>; 2],
}

impl Transform {
    /// A transform for pictures of at least this size; sizes are rounded up to those that are fast.
    pub fn new(width: usize, height: usize) -> Self {
        let (width, height) = (fast(width), fast(height));
        // Scalar, so that all machines give the same bits.
        let mut planner = FftPlannerScalar::new();
        Transform {
            width,
            height,
            rows: [
                planner.plan_fft_forward(width),
                planner.plan_fft_inverse(width),
            ],
            columns: [
                planner.plan_fft_forward(height),
                planner.plan_fft_inverse(height),
            ],
        }
    }

    /// Width and height of the pictures.
    pub fn size(&self) -> [usize; 2] {
        [self.width, self.height]
    }

    /// An empty picture.
    pub fn picture(&self) -> Vec<Number> {
        vec![Number::default(); self.width * self.height]
    }

    /// A cyclic convolution of the real parts, over the picture's number of texels: all layers' spectra are added
    /// before they are transformed back.
    pub fn forward(&self, picture: Vec<Number>) -> Vec<Number> {
        self.both(picture, 0)
    }

    /// The picture of a spectrum, its texels' values 1 where the spectrum of a single 1 comes back.
    pub fn inverse(&self, spectrum: Vec<Number>) -> Vec<f32> {
        let scale = 1.0 / (self.width * self.height) as f32;
        let (width, height) = (self.width, self.height);
        let mut turned = turn(&spectrum, height, width);
        run(&mut turned, width, &self.rows[1]);
        let mut picture = turn(&turned, width, height);
        run(&mut picture, height, &self.columns[1]);
        let picture = turn(&picture, height, width);
        picture.iter().map(|c| c.re * scale).collect()
    }

    /// The spectrum, in columns.
    fn both(&self, mut picture: Vec<Number>, direction: usize) -> Vec<Number> {
        run(&mut picture, self.width, &self.rows[direction]);
        let mut turned = turn(&picture, self.width, self.height);
        run(&mut turned, self.height, &self.columns[direction]);
        turned
    }
}

/// Transforms every row.
fn run(picture: &mut [Number], width: usize, fft: &Arc<dyn Fft<f32>>) {
    let scratch = || vec![Number::default(); fft.get_inplace_scratch_len()];
    picture
        .par_chunks_mut(width)
        .with_min_len(16)
        .for_each_init(scratch, |scratch, row| {
            fft.process_with_scratch(row, scratch)
        });
}

/// Rows to columns.
fn turn(picture: &[Number], width: usize, height: usize) -> Vec<Number> {
    let mut out = vec![Number::default(); picture.len()];
    for (x, column) in out.chunks_mut(height).enumerate() {
        for (y, value) in column.iter_mut().enumerate() {
            *value = picture[y * width + x];
        }
    }
    out
}

/// The next size that has no prime factors above 5.
fn fast(size: usize) -> usize {
    let smooth = |mut n: usize| {
        for p in [2, 3, 5] {
            while n.is_multiple_of(p) {
                n /= p;
            }
        }
        n == 1
    };
    (size.max(1)..).find(|&n| smooth(n)).unwrap_or(size)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_product_of_spectra_is_a_convolution() {
        let transform = Transform::new(13, 7);
        let [w, h] = transform.size();
        assert_eq!([w, h], [15, 8]);
        let mut picture = transform.picture();
        let mut kernel = transform.picture();
        for (x, y, v) in [(2, 3, 1.0), (9, 1, 2.0), (14, 7, -1.0)] {
            picture[y * w + x].re = v;
        }
        for (x, y, v) in [(0, 0, 0.5), (1, 0, 0.25), (w - 1, h - 1, 0.125)] {
            kernel[y * w + x].re = v;
        }
        let mut expected = vec![0.0f32; w * h];
        for (i, p) in picture.iter().enumerate() {
            for (k, q) in kernel.iter().enumerate() {
                let (x, y) = ((i % w + k % w) % w, (i / w + k / w) % h);
                expected[y * w + x] += p.re * q.re;
            }
        }
        let (a, b) = (transform.forward(picture), transform.forward(kernel));
        let product = a.iter().zip(&b).map(|(a, b)| a * b).collect();
        let found = transform.inverse(product);
        for (f, e) in found.iter().zip(&expected) {
            // A few roundings of numbers up to 2, in 120 terms.
            assert!((f - e).abs() < 1e-5, "{f} {e}");
        }
    }
}
