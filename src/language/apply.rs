//! Executes one line: it changes the settings, or changes nothing and reports the wrong word.
//!
//! [`apply`] parses the whole line against the current settings before it changes them. The console, the configuration file and
//! `show config` use the same lines.

use super::changed::Changed;
use super::listed::listed;
use super::problem::{LineError, Problem, Warning};
use super::verbs::{Lack, VERBS, Verb};
use super::words::{Words, Wrong};
use crate::settings::{LINE_BYTES_MAX, Settings};

/// The effect of a valid line.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Applied {
    /// Whether the settings have changed; false for blank lines and comments.
    pub changed: bool,
    /// A likely mistake.
    pub warning: Option<Warning>,
}

/// Changes `settings` by `line`; an invalid line changes nothing.
pub fn apply(settings: &mut Settings, line: &str) -> Result<Applied, LineError> {
    if line.len() > LINE_BYTES_MAX {
        return Err(LineError::too_long());
    }
    let words = Words::new(line);
    let changed = match change(settings, &words) {
        Ok(changed) => changed,
        Err(Wrong) => return Err(words.wrong()),
    };
    let warning = match changed {
        Changed::Port(id) => settings.port_warning(id),
        Changed::Rule(n) => settings.rule_warning(n).or_else(|| settings.shadow_warning(n)),
        Changed::Nothing | Changed::Other => None,
    };
    Ok(Applied { changed: changed != Changed::Nothing, warning })
}

fn change(settings: &mut Settings, words: &Words) -> Result<Changed, Wrong> {
    let verb = words.take();
    if verb.is_end() {
        return Ok(Changed::Nothing);
    }
    let Verb { lacks, run, .. } = verb.keyword(VERBS, VERBS_EXPECTED)?;
    match lacks {
        Some(Lack::Points) => Err(verb.error(Problem::NoPoints)),
        Some(Lack::Servers) => Err(verb.error(Problem::NoServers)),
        Some(Lack::Tls) => Err(verb.error(Problem::NoTls)),
        Some(Lack::Mqtt) => Err(verb.error(Problem::NoMqtt)),
        Some(Lack::Users) => Err(verb.error(Problem::NoUsers)),
        None => run(settings, words),
    }
}

const VERBS_EXPECTED: &str = listed!(VERBS);
