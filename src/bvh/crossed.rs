//! How many surfaces of each transmittance a segment has crossed.

/// Crossings counted by transmittance, so that their product does not depend on the order in which a tree
/// gives them. Scenes have few opacities.
#[derive(Debug, Clone, Default)]
pub(super) struct Crossed(Vec<(f32, i32)>);

impl Crossed {
    pub(super) fn clear(&mut self) {
        self.0.clear();
    }

    #[inline(always)]
    pub(super) fn add(&mut self, through: f32, crossings: i32) {
        match self.0.iter_mut().find(|(t, _)| *t == through) {
            Some((_, count)) => *count += crossings,
            None => self.0.push((through, crossings)),
        }
    }

    pub(super) fn product(&mut self) -> f32 {
        self.0.sort_unstable_by(|a, b| a.0.total_cmp(&b.0));
        let power = |&(t, count): &(f32, i32)| f64::from(t).powi(count);
        self.0.iter().map(power).product::<f64>() as f32
    }
}
