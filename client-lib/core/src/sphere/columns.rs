//! Spheres as the engines read them: one array a component, in f64.

use super::Sphere;
use super::exact::Ball;
use crate::aligned::AlignedBuffer;
use crate::cancel::{BOX_TESTS, Cancel, Pace};
use crate::engine::{Census, CullError};

/// Columns that one 64-bit word covers: what the arrays are padded to.
pub(super) const WORD_COLUMNS: usize = 64;

/// The four components of 64 spheres: x, y, z, radius.
pub(super) type Columns<'a> = [&'a [f64; WORD_COLUMNS]; 4];

/// All spheres in four arrays, padded to a multiple of [`WORD_COLUMNS`] with spheres that overlap
/// nothing. Memory is kept from frame to frame.
#[derive(Default)]
pub(super) struct BallColumns {
    components: AlignedBuffer<f64>,
    len: usize,
    padded_len: usize,
}

impl BallColumns {
    pub fn allocated_bytes(&self) -> usize {
        self.components.allocated_bytes()
    }

    /// Reads all spheres, each once, and counts those that overlap nothing.
    ///
    /// # Errors
    /// [`CullError::Cancelled`].
    pub fn ingest(&mut self, spheres: &[Sphere], cancel: &Cancel) -> Result<Census, CullError> {
        self.len = spheres.len();
        self.padded_len = spheres.len().next_multiple_of(WORD_COLUMNS);
        self.components.resize(4 * self.padded_len);
        let mut census = Census::default();
        let (x, rest) = self.components.as_mut_slice().split_at_mut(self.padded_len);
        let (y, rest) = rest.split_at_mut(self.padded_len);
        let (z, radius) = rest.split_at_mut(self.padded_len);
        let mut pace = Pace::default();
        for (i, sphere) in spheres.iter().enumerate() {
            if cancel.look_after(BOX_TESTS, &mut pace) {
                return Err(CullError::Cancelled);
            }
            // Copied once: a client could write to it meanwhile.
            let sphere = *sphere;
            census.note(i as u32, sphere.class());
            let ball = Ball::of(&sphere);
            [x[i], y[i], z[i]] = ball.center;
            radius[i] = ball.radius;
        }
        for i in self.len..self.padded_len {
            [x[i], y[i], z[i]] = Ball::NOTHING.center;
            radius[i] = Ball::NOTHING.radius;
        }
        Ok(census)
    }

    /// Spheres ingested.
    pub fn len(&self) -> usize {
        self.len
    }

    #[inline]
    pub fn ball(&self, index: usize) -> Ball {
        let [x, y, z, radius] = self.arrays().map(|component| component[index]);
        Ball { center: [x, y, z], radius }
    }

    /// The columns of 64-bit word `word`.
    #[inline(always)]
    pub fn word(&self, word: usize) -> Columns<'_> {
        self.arrays().map(|component| &component.as_chunks().0[word])
    }

    #[inline(always)]
    fn arrays(&self) -> [&[f64]; 4] {
        let all = self.components.as_slice();
        std::array::from_fn(|c| &all[c * self.padded_len..][..self.padded_len])
    }
}
