//! Steps as sentences in the order of time, each of which does or expects one thing.

use std::ops::RangeInclusive;

use crate::words::duration;

/// The sentences of `steps`, each with its line. Responses to questions that are asked side by side come behind all of them.
pub(crate) fn sentences(steps: &str) -> Vec<(&str, String)> {
    let (mut sentences, mut responses) = (Vec::new(), Vec::new());
    for line in steps.lines().map(str::trim).filter(|line| !line.is_empty() && !line.starts_with('#')) {
        let sentence = match beside(line) {
            Some((pause, sentence)) => {
                sentences.extend(pause.map(|pause| (line, format!("wait {pause}"))));
                sentence
            }
            None => {
                sentences.append(&mut responses);
                line
            }
        };
        match exchange(sentence) {
            Some((question, response)) => {
                sentences.push((line, question.to_owned()));
                responses.push((line, response));
            }
            None => sentences.push((line, sentence.to_owned())),
        }
    }
    sentences.append(&mut responses);
    sentences
}

/// What happens before the responses to the lines above: `and ...`, `5ms later ...`.
fn beside(line: &str) -> Option<(Option<&str>, &str)> {
    let (time, rest) = line.split_once(' ')?;
    match rest.strip_prefix("later ") {
        Some(rest) if duration(time).is_ok() => Some((Some(time), rest)),
        _ => (time == "and").then_some((None, rest)),
    }
}

/// `scada asks ... -> ...` as a question and what its client gets.
pub(crate) fn exchange(sentence: &str) -> Option<(&str, String)> {
    let (question, response) = sentence.split_once(" -> ")?;
    let (client, _) = question.split_once(' ')?;
    (!question.contains(" times: ")).then(|| (question, format!("{client} gets {response}")))
}

/// The lines that `for n in 1-3 5: ... {n} ...; ...` stands for; every other line is itself.
pub(crate) fn each(line: &str) -> Vec<String> {
    let list = line.trim_start().strip_prefix("for n in ").and_then(|rest| rest.split_once(": "));
    let Some((list, text)) = list else { return vec![line.to_owned()] };
    let lines = |n: String| text.split("; ").map(move |line| line.replace("{n}", &n));
    items(list).flat_map(lines).collect()
}

/// The words of `list`, with the numbers of each range such as `1-3`.
pub(crate) fn items(list: &str) -> impl Iterator<Item = String> {
    list.split_whitespace().flat_map(|item| {
        let range =
            item.split_once('-').and_then(|(first, last)| Some(first.parse().ok()?..=last.parse().ok()?));
        range.map_or_else(
            || vec![item.to_owned()],
            |range: RangeInclusive<u16>| range.map(|n| n.to_string()).collect(),
        )
    })
}
