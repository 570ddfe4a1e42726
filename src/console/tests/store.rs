//! A store in memory, which keeps all versions.

use std::string::{String, ToString};
use std::vec::Vec;

use super::std;
use crate::hal::{Store, StoreError};

/// A store in memory.
#[derive(Default)]
pub(super) struct Memory {
    pub(super) saved: Vec<u8>,
    pub(super) next: Vec<u8>,
    pub(super) absent: bool,
    pub(super) who: String,
    /// What was saved, from the last one on, and by whom.
    pub(super) versions: Vec<(String, Vec<u8>)>,
}

impl Store for Memory {
    async fn read(&mut self, offset: usize, into: &mut [u8]) -> Result<usize, StoreError> {
        Ok(copy(&self.saved, offset, into))
    }

    async fn append(&mut self, text: &[u8]) -> Result<(), StoreError> {
        if self.absent {
            return Err(StoreError::Absent("start with --config FILE"));
        }
        self.next.extend_from_slice(text);
        Ok(())
    }

    async fn commit(&mut self) -> Result<(), StoreError> {
        self.saved = std::mem::take(&mut self.next);
        self.versions.insert(0, (self.who.clone(), self.saved.clone()));
        Ok(())
    }

    fn sign(&mut self, who: &dyn std::fmt::Display, _: impl FnOnce() -> Option<u64>) {
        self.who = who.to_string();
    }

    fn write_version(&mut self, nth: usize, out: &mut dyn std::fmt::Write) -> Option<std::fmt::Result> {
        let (who, _) = self.versions.get(nth)?;
        Some(write!(out, "2026-11-25T21:40:00Z\t+1 -0\t{who}"))
    }

    async fn read_version(
        &mut self,
        nth: usize,
        offset: usize,
        into: &mut [u8],
    ) -> Result<usize, StoreError> {
        let Some((_, text)) = self.versions.get(nth) else { return Ok(0) };
        Ok(copy(text, offset, into))
    }
}

/// Copies what fits of `text` from `offset` on, and returns how much that is.
fn copy(text: &[u8], offset: usize, into: &mut [u8]) -> usize {
    let rest = text.get(offset..).unwrap_or_default();
    let count = rest.len().min(into.len());
    into[..count].copy_from_slice(&rest[..count]);
    count
}
