//! Which file takes what from which other one.

use std::collections::{BTreeMap, BTreeSet};
use std::path::PathBuf;

use crate::source::{Module, ModulePath, Names};

/// Names that a file takes from others, by those.
pub(crate) type Imports = BTreeMap<PathBuf, BTreeMap<PathBuf, BTreeSet<String>>>;

/// Most `use` that stand for one another.
const ALIASES_MAX: usize = 16;

/// What the files of `modules` take from each other. A name counts for the file that defines it, whoever hands it on.
pub(crate) fn imports(modules: &BTreeMap<ModulePath, Module>) -> Imports {
    let mut imports = Imports::new();
    for (path, module) in modules {
        let globs = module.globs.iter().map(|names| names.iter().cloned().chain(["*".to_owned()]).collect());
        for names in module.imports.values().chain(&module.mentions).cloned().chain(globs.collect::<Vec<_>>())
        {
            let Some((file, name)) = resolve(modules, path, &names, ALIASES_MAX) else { continue };
            if file != module.file {
                imports.entry(module.file.clone()).or_default().entry(file).or_default().insert(name);
            }
        }
    }
    imports
}

/// The file that defines what `names` stand for in module `at`, and its name there; none for other crates and for modules.
fn resolve(
    modules: &BTreeMap<ModulePath, Module>,
    at: &ModulePath,
    names: &[String],
    aliases: usize,
) -> Option<(PathBuf, String)> {
    let (first, rest) = names.split_first()?;
    let module = &modules[at];
    match first.as_str() {
        "crate" => inside(modules, Vec::new(), rest, aliases),
        "self" => inside(modules, at.clone(), rest, aliases),
        "super" => inside(modules, at.split_last()?.1.to_vec(), rest, aliases),
        name if module.children.contains(name) || module.items.contains(name) => {
            inside(modules, at.clone(), names, aliases)
        }
        name => {
            let stands_for = module.imports.get(name).or_else(|| module.exports.get(name))?;
            // `use log::Log`: the name of another crate.
            if stands_for.first() == Some(first) {
                return None;
            }
            let names: Names = stands_for.iter().chain(rest).cloned().collect();
            resolve(modules, at, &names, aliases.checked_sub(1)?)
        }
    }
}

/// The same for `names` as seen from within module `at`.
fn inside(
    modules: &BTreeMap<ModulePath, Module>,
    mut at: ModulePath,
    names: &[String],
    aliases: usize,
) -> Option<(PathBuf, String)> {
    for (nth, name) in names.iter().enumerate() {
        let module = &modules[&at];
        if name == "super" {
            at.pop();
        } else if module.children.contains(name) {
            at.push(name.clone());
        } else if module.items.contains(name) {
            return Some((module.file.clone(), name.clone()));
        } else if let Some(stands_for) = module.imports.get(name).or_else(|| module.exports.get(name)) {
            let names: Names = stands_for.iter().chain(&names[nth + 1..]).cloned().collect();
            return resolve(modules, &at, &names, aliases.checked_sub(1)?);
        } else {
            return Some((module.file.clone(), name.clone()));
        }
    }
    None
}

/// Groups of files that import each other in a circle.
pub(crate) fn circles(imports: &Imports) -> Vec<BTreeSet<PathBuf>> {
    let reached: BTreeMap<&PathBuf, BTreeSet<&PathBuf>> =
        imports.keys().map(|file| (file, reachable(imports, file))).collect();
    let mut circles: Vec<BTreeSet<PathBuf>> = Vec::new();
    for (file, others) in &reached {
        let back = |other: &&&PathBuf| reached.get(**other).is_some_and(|reached| reached.contains(file));
        let circle: BTreeSet<PathBuf> = others.iter().filter(back).map(|other| (*other).clone()).collect();
        if !circle.is_empty() && !circles.contains(&circle) {
            circles.push(circle);
        }
    }
    circles
}

fn reachable<'i>(imports: &'i Imports, file: &PathBuf) -> BTreeSet<&'i PathBuf> {
    let mut reached = BTreeSet::new();
    let mut next: Vec<&PathBuf> = imports.get(file).into_iter().flat_map(BTreeMap::keys).collect();
    while let Some(file) = next.pop() {
        if reached.insert(file) {
            next.extend(imports.get(file).into_iter().flat_map(BTreeMap::keys));
        }
    }
    reached
}
