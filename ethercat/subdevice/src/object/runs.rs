//! The content of a PDO: runs of entries, and padding.

/// Most runs in a PDO; every object reserves room for them.
pub const RUNS_MAX: usize = 6;

/// The content of a PDO, in order.
#[derive(Debug, Clone, Copy)]
pub struct Runs {
    runs: [Mapped; RUNS_MAX],
    used: u8,
}

impl Runs {
    /// Empty.
    pub const NONE: Self = Self { runs: [Mapped { index: 0, sub: 0, count: 0, bits: 0 }; RUNS_MAX], used: 0 };

    /// Appends `run`; `None` if there are [`RUNS_MAX`] already.
    #[must_use]
    pub const fn and(mut self, run: Mapped) -> Option<Self> {
        if self.used as usize >= RUNS_MAX {
            return None;
        }
        self.runs[self.used as usize] = run;
        self.used += 1;
        Some(self)
    }

    /// All of `runs`.
    ///
    /// # Panics
    /// If there are too many; at build time, in a `const`.
    pub(super) const fn of(runs: &[Mapped]) -> Self {
        let (mut all, mut nth) = (Self::NONE, 0);
        while nth < runs.len() {
            let Some(more) = all.and(runs[nth]) else { panic!("a PDO has too many runs") };
            (all, nth) = (more, nth + 1);
        }
        all
    }

    /// The runs, by value.
    pub(super) fn all(self) -> impl Iterator<Item = Mapped> {
        self.runs.into_iter().take(self.used.into())
    }

    /// The runs.
    pub fn iter(&self) -> impl Iterator<Item = &Mapped> {
        self.runs.iter().take(self.used.into())
    }
}

/// The index of padding, which is no entry.
pub const PADDING: u16 = 0;

/// A run of one object's entries in a PDO.
#[derive(Debug, Clone, Copy)]
pub struct Mapped {
    /// The object.
    pub index: u16,
    /// The first sub-index.
    pub sub: u8,
    /// Number of entries.
    pub count: u8,
    /// Bits per entry.
    pub bits: u8,
}
