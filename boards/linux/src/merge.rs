//! Merges new settings into an old text: unchanged lines stay as they are, and so do comments, blank lines and the order.
//!
//! A changed line is rewritten in place and keeps its trailing comment. New lines go after the last of their kind; lines of removed
//! settings are deleted. The merged text is read back: if its order does not work (a rule before its port), the lines come in the
//! order of `show config`, each with the comments above it.

use std::collections::HashMap;

use mobgate::settings::{LINE_BYTES_MAX, Settings};

use line::{Does, Item, Line, MDNS, ROUTE, printed};

mod line;

const BYTE_ORDER_MARK: &str = "\u{feff}";

/// Changes the text `old` to mean the same as `new`, which is printed settings.
pub fn merge(old: &str, new: &str) -> String {
    let (mark, text) = old.strip_prefix(BYTE_ORDER_MARK).map_or(("", old), |text| (BYTE_ORDER_MARK, text));
    // A line of unknown kind could not be found in the old text.
    let lines = new.lines().filter(|line| !line.is_empty());
    let Some(mut items) = lines.map(Item::of).collect::<Option<Vec<_>>>() else { return new.to_owned() };
    let (before, wanted) = (Text::read(text), Text::read(new));
    let says_it = |text: &Text| text.is_good && text.things() == wanted.things();
    // An empty file would count as missing.
    if !old.is_empty() && says_it(&before) {
        return old.to_owned();
    }
    // The default is not printed, but a line that says it stays.
    let has_line =
        before.lines.iter().any(|line| matches!(&line.does, Does::Makes(item) if item.kind == MDNS));
    if has_line && !items.iter().any(|item| item.kind == MDNS) {
        items.extend(Item::of("mdns on"));
        items.sort_by_key(|item| item.kind);
    }
    let plan = Plan::new(&before.lines, &items);
    let mut merged = [Plan::in_place, Plan::in_order].into_iter().map(|arrange| arrange(&plan));
    let merged = merged.find(|text| !text.is_empty() && says_it(&Text::read(text)));
    // Lines of settings alone are always readable.
    merged.map_or_else(|| new.to_owned(), |text| mark.to_owned() + &text)
}

/// A text, line by line, and its settings.
struct Text<'t> {
    lines: Vec<Line<'t>>,
    settings: Box<Settings>,
    /// No line has an error.
    is_good: bool,
}

impl<'t> Text<'t> {
    fn read(text: &'t str) -> Self {
        let mut read = Self { lines: Vec::new(), settings: Box::default(), is_good: true };
        for raw in text.split_inclusive('\n') {
            let line = Line::read(raw, &mut read.settings);
            read.is_good &= !matches!(line.does, Does::Wrong);
            read.lines.push(line);
        }
        read
    }

    /// The resulting settings, sorted where the order of lines does not matter: it matters for rules only.
    fn things(&self) -> Vec<Item> {
        let mut things = (0..).map_while(|n| printed(&self.settings, n)).collect::<Vec<_>>();
        things.sort_by(|one, other| (one.kind, &one.name).cmp(&(other.kind, &other.name)));
        things
    }
}

/// The fate of each old line, and where new lines go.
struct Plan<'t> {
    lines: &'t [Line<'t>],
    items: &'t [Item],
    /// For each line, the item that it is or becomes.
    places: Vec<Option<usize>>,
    /// Items to insert before a line that they must precede, and after the line that they must follow.
    before: HashMap<usize, Vec<usize>>,
    behind: HashMap<usize, Vec<usize>>,
    /// Items to append at the end.
    last: Vec<usize>,
}

impl<'t> Plan<'t> {
    fn new(lines: &'t [Line<'t>], items: &'t [Item]) -> Self {
        let places = vec![None; lines.len()];
        let mut plan =
            Self { lines, items, places, before: HashMap::new(), behind: HashMap::new(), last: Vec::new() };
        plan.place_named();
        let rules = plan.place_rules();
        plan.place_added(&rules);
        plan
    }

    /// The lines that create items of these kinds, first to last.
    fn makers(&self, of: impl Fn(usize) -> bool) -> impl Iterator<Item = (usize, &'t Item)> {
        self.lines.iter().enumerate().filter_map(move |(at, line)| match &line.does {
            Does::Makes(item) if of(item.kind) => Some((at, item)),
            _ => None,
        })
    }

    /// Assigns lines to named items. Of two lines with the same name the later one counts.
    fn place_named(&mut self) {
        let named = |item: &Item| (item.kind, item.name.clone());
        let old = self.makers(|kind| kind != ROUTE).map(|(at, item)| (named(item), at));
        let old = old.collect::<HashMap<_, _>>();
        for (n, item) in self.items.iter().enumerate().filter(|(_, item)| item.kind != ROUTE) {
            if let Some(&at) = old.get(&named(item)) {
                self.places[at] = Some(n);
            }
        }
    }

    /// Assigns lines to rules, whose order matters: equal rules stay, and between two of them new rules replace old ones. Returns
    /// the rules without a position.
    fn place_rules(&mut self) -> Vec<usize> {
        let old = self.makers(|kind| kind == ROUTE).collect::<Vec<_>>();
        let new = self.items.iter().enumerate().filter(|(_, item)| item.kind == ROUTE).collect::<Vec<_>>();
        let mut fixed = longest_common(old.len(), new.len(), |i, j| old[i].1.says_the_same(new[j].1));
        fixed.push((old.len(), new.len()));
        let (mut i, mut j, mut homeless) = (0, 0, Vec::new());
        for (next_i, next_j) in fixed {
            let replaced = (next_i - i).min(next_j - j);
            for (old, new) in old[i..].iter().zip(&new[j..]).take(replaced) {
                self.places[old.0] = Some(new.0);
            }
            let added = new[j + replaced..next_j].iter().map(|(n, _)| *n);
            match (i + replaced).checked_sub(1).map(|at| old[at].0).filter(|at| self.places[*at].is_some()) {
                Some(at) => self.behind.entry(at).or_default().extend(added),
                None if next_i < old.len() => {
                    let at = self.with_comments(old[next_i].0);
                    self.before.entry(at).or_default().extend(added);
                }
                None => homeless.extend(added),
            }
            if let (Some(old), Some(new)) = (old.get(next_i), new.get(next_j)) {
                self.places[old.0] = Some(new.0);
            }
            (i, j) = (next_i + 1, next_j + 1);
        }
        homeless
    }

    /// The first of the comment lines directly above line `at`, or that line itself.
    fn with_comments(&self, at: usize) -> usize {
        let is_comment = |line: &Line<'_>| line.comment.is_some() && matches!(line.does, Does::Nothing);
        at - self.lines[..at].iter().rev().take_while(|line| is_comment(line)).count()
    }

    /// Positions the remaining items: after the last line of their kind, or of the kinds they may depend on, and after the items of
    /// those kinds added before.
    fn place_added(&mut self, rules: &[usize]) {
        let is_placed = |plan: &Self, n: &usize| plan.places.contains(&Some(*n));
        let added = (0..self.items.len()).filter(|n| match self.items[*n].kind {
            ROUTE => rules.contains(n),
            _ => !is_placed(self, n),
        });
        let mut least = None;
        for n in added.collect::<Vec<_>>() {
            let kind = self.items[n].kind;
            let last_of = |of: &dyn Fn(usize) -> bool| {
                let placed = |(at, _): &(usize, &Item)| self.places[*at].is_some();
                self.makers(of).filter(placed).map(|(at, _)| at).last()
            };
            let spot = last_of(&|other| other == kind).or_else(|| last_of(&|other| other < kind)).max(least);
            match spot {
                Some(at) if self.last.is_empty() => self.behind.entry(at).or_default().push(n),
                _ => self.last.push(n),
            }
            least = spot;
        }
    }

    /// Each line at its old position.
    fn in_place(&self) -> String {
        let mut text = self.text();
        for at in 0..self.lines.len() {
            self.before.get(&at).into_iter().flatten().for_each(|n| text.add(&self.items[*n].text));
            text.add_line(self, at);
            self.behind.get(&at).into_iter().flatten().for_each(|n| text.add(&self.items[*n].text));
        }
        self.last.iter().for_each(|n| text.add(&self.items[*n].text));
        text.text
    }

    /// The lines in the order of the items, with the comments above them.
    fn in_order(&self) -> String {
        let mut blocks: HashMap<usize, Vec<usize>> = HashMap::new();
        let mut pending = Vec::new();
        for (at, place) in self.places.iter().enumerate() {
            pending.push(at);
            if let Some(n) = place {
                blocks.insert(*n, std::mem::take(&mut pending));
            }
        }
        let mut text = self.text();
        for (n, item) in self.items.iter().enumerate() {
            match blocks.get(&n) {
                Some(lines) => lines.iter().for_each(|at| text.add_line(self, *at)),
                None => text.add(&item.text),
            }
        }
        pending.iter().for_each(|at| text.add_line(self, *at));
        text.text
    }

    fn text(&self) -> Output {
        let crlf = self.lines.first().is_some_and(|line| line.raw.ends_with("\r\n"));
        Output { text: String::new(), line_end: if crlf { "\r\n" } else { "\n" } }
    }
}

/// The text being written.
struct Output {
    text: String,
    line_end: &'static str,
}

impl Output {
    fn add_raw(&mut self, raw: &str) {
        // The last line of the old text may lack a line end.
        if !self.text.is_empty() && !self.text.ends_with('\n') {
            self.text.push_str(self.line_end);
        }
        self.text.push_str(raw);
    }

    fn add(&mut self, line: &str) {
        self.add_raw(line);
        self.text.push_str(self.line_end);
    }

    /// Writes what line `at` of the old text has become.
    fn add_line(&mut self, plan: &Plan<'_>, at: usize) {
        let line = &plan.lines[at];
        match (&line.does, plan.places[at]) {
            (Does::Nothing, _) => self.add_raw(line.raw),
            (Does::Makes(old), Some(n)) if old.says_the_same(&plan.items[n]) => self.add_raw(line.raw),
            (_, Some(n)) => match (&plan.items[n].text, line.comment) {
                (new, Some(comment)) if new.len() + 1 + comment.len() <= LINE_BYTES_MAX => {
                    self.add(&format!("{new} {comment}"));
                }
                (new, comment) => {
                    comment.into_iter().for_each(|comment| self.add(comment));
                    self.add(new);
                }
            },
            // Its effect is in the lines that it edited.
            (Does::Edits, None) => line.comment.into_iter().for_each(|comment| self.add(comment)),
            (Does::Makes(_) | Does::Wrong, None) => {}
        }
    }
}

/// Index pairs of a longest common subsequence of two lists, whose elements `same` compares.
fn longest_common(old: usize, new: usize, same: impl Fn(usize, usize) -> bool) -> Vec<(usize, usize)> {
    let mut lengths = vec![vec![0_u32; new + 1]; old + 1];
    for i in (0..old).rev() {
        for j in (0..new).rev() {
            lengths[i][j] = match same(i, j) {
                true => lengths[i + 1][j + 1] + 1,
                false => lengths[i + 1][j].max(lengths[i][j + 1]),
            };
        }
    }
    let (mut i, mut j, mut pairs) = (0, 0, Vec::new());
    while i < old && j < new {
        if same(i, j) {
            pairs.push((i, j));
            (i, j) = (i + 1, j + 1);
        } else if lengths[i + 1][j] >= lengths[i][j + 1] {
            i += 1;
        } else {
            j += 1;
        }
    }
    pairs
}

#[cfg(test)]
mod tests;
