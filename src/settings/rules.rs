//! Sets of rules, for errors and warnings.

use core::fmt;

use crate::settings::ROUTES_MAX;

/// A set of rules, by index.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Rules(u64);

const _: () = assert!(ROUTES_MAX <= u64::BITS as usize);

impl Rules {
    /// The rules, counted from 0, for which the iterator yields true; `None` if there are none.
    pub(crate) fn of(named: impl Iterator<Item = bool>) -> Option<Self> {
        let set = named.take(ROUTES_MAX).enumerate().fold(0, |set, (at, named)| set | u64::from(named) << at);
        (set != 0).then_some(Self(set))
    }

    /// The rule at index `at`.
    pub(crate) fn one(at: usize) -> Self {
        let mut one = Self::default();
        one.add(at);
        one
    }

    /// Adds the rule at index `at`.
    pub(crate) fn add(&mut self, at: usize) {
        self.0 |= 1_u64.checked_shl(at as u32).unwrap_or(0);
    }

    /// Whether the rule at index `at` is in the set.
    pub(crate) fn contains(&self, at: usize) -> bool {
        self.0.checked_shr(at as u32).unwrap_or(0) & 1 == 1
    }

    /// The union.
    pub(crate) fn with(self, others: Self) -> Self {
        Self(self.0 | others.0)
    }

    pub(crate) fn verb<'v>(&self, one: &'v str, many: &'v str) -> &'v str {
        if self.0.count_ones() > 1 { many } else { one }
    }
}

/// `rule 3`, `rules 1, 3, 6`.
impl fmt::Display for Rules {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.verb("rule", "rules"))?;
        let numbers = (0..ROUTES_MAX).filter(|at| self.contains(*at)).map(|at| at + 1);
        for (nth, number) in numbers.enumerate() {
            write!(f, "{} {number}", if nth == 0 { "" } else { "," })?;
        }
        Ok(())
    }
}
