//! Reads the modules of a crate from their files: what each declares, imports and names.

use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};

use proc_macro2::{TokenStream, TokenTree};
use syn::spanned::Spanned;
use syn::visit::{self, Visit};
use syn::{Attribute, Ident, Item, ItemMod, Meta, UseTree};

/// The names of a module, from the crate's root on; empty for the root.
pub(crate) type ModulePath = Vec<String>;

/// A path in the code, by its names.
pub(crate) type Names = Vec<String>;

#[derive(Default)]
pub(crate) struct Module {
    /// Where it is, from the folder of the crate's root on.
    pub(crate) file: PathBuf,
    pub(crate) children: BTreeSet<String>,
    /// What it defines by itself.
    pub(crate) items: BTreeSet<String>,
    /// Names that `use` brings in, with what they stand for.
    pub(crate) imports: BTreeMap<String, Names>,
    /// The same of names that the module only hands on.
    pub(crate) exports: BTreeMap<String, Names>,
    /// Modules of which it imports all.
    pub(crate) globs: Vec<Names>,
    /// Paths of at least two names that its code mentions.
    pub(crate) mentions: BTreeSet<Names>,
}

/// The modules below `root`, a crate's first file, without those that are compiled for tests alone.
pub(crate) fn modules(root: &Path) -> BTreeMap<ModulePath, Module> {
    let folder = root.parent().unwrap();
    let mut modules = BTreeMap::new();
    read(folder, Path::new(root.file_name().unwrap()), folder, Vec::new(), &mut modules);
    modules
}

fn read(
    folder: &Path,
    file: &Path,
    children_in: &Path,
    path: ModulePath,
    modules: &mut BTreeMap<ModulePath, Module>,
) {
    let text = std::fs::read_to_string(folder.join(file)).unwrap_or_else(|error| panic!("{file:?}: {error}"));
    let parsed = syn::parse_file(&text).unwrap_or_else(|error| panic!("{file:?}: {error}"));
    let mut module = Module { file: file.to_owned(), ..Module::default() };
    for item in &parsed.items {
        let Item::Mod(child) = item else { continue };
        if is_for_tests(&child.attrs) || child.content.is_some() {
            continue;
        }
        let name = child.ident.to_string();
        let in_child: ModulePath = path.iter().cloned().chain([name.clone()]).collect();
        let default = children_in.join(format!("{name}.rs"));
        module.children.insert(name.clone());
        read(folder, default.strip_prefix(folder).unwrap(), &children_in.join(&name), in_child, modules);
        if let Some(twin) = twin(child) {
            let name = format!("{name} (else)");
            let in_twin: ModulePath = path.iter().cloned().chain([name.clone()]).collect();
            let file = folder.join(file).parent().unwrap().join(twin);
            read(folder, file.strip_prefix(folder).unwrap(), &children_in.join(&name), in_twin, modules);
        }
    }
    Reader { module: &mut module }.visit_file(&parsed);
    modules.insert(path, module);
}

/// The file that a module has instead where a feature is off.
fn twin(module: &ItemMod) -> Option<String> {
    module.attrs.iter().filter(|attribute| attribute.path().is_ident("cfg_attr")).find_map(|attribute| {
        let Meta::List(list) = &attribute.meta else { return None };
        let text = list.tokens.to_string();
        let (_, value) = text.split_once("path = \"")?;
        value.split_once('"').map(|(value, _)| value.to_owned())
    })
}

fn is_for_tests(attributes: &[Attribute]) -> bool {
    attributes.iter().any(|attribute| {
        let Meta::List(list) = &attribute.meta else { return false };
        attribute.path().is_ident("cfg") && list.tokens.to_string() == "test"
    })
}

struct Reader<'m> {
    module: &'m mut Module,
}

impl Reader<'_> {
    fn import(&mut self, tree: &UseTree, before: &Names, hands_on: bool) {
        let with = |name: &Ident| before.iter().cloned().chain([name.to_string()]).collect::<Names>();
        let names = if hands_on { &mut self.module.exports } else { &mut self.module.imports };
        match tree {
            UseTree::Path(path) => self.import(&path.tree, &with(&path.ident), hands_on),
            UseTree::Name(name) if name.ident == "self" => {
                names.insert(before.last().unwrap().clone(), before.clone());
            }
            UseTree::Name(name) => {
                names.insert(name.ident.to_string(), with(&name.ident));
            }
            UseTree::Rename(rename) => {
                names.insert(rename.rename.to_string(), with(&rename.ident));
            }
            UseTree::Glob(_) => self.module.globs.push(before.clone()),
            UseTree::Group(group) => group.items.iter().for_each(|tree| self.import(tree, before, hands_on)),
        }
    }

    /// Finds paths in what a macro is given.
    fn tokens(&mut self, tokens: TokenStream) {
        let (mut names, mut colons) = (Names::new(), 0);
        for token in tokens {
            match token {
                TokenTree::Ident(name) => {
                    if colons != 2 {
                        self.mention(std::mem::take(&mut names));
                    }
                    names.push(name.to_string());
                    colons = 0;
                }
                TokenTree::Punct(mark) if mark.as_char() == ':' => colons += 1,
                other => {
                    self.mention(std::mem::take(&mut names));
                    colons = 0;
                    if let TokenTree::Group(group) = other {
                        self.tokens(group.stream());
                    }
                }
            }
        }
        self.mention(names);
    }

    fn mention(&mut self, names: Names) {
        if names.len() > 1 {
            self.module.mentions.insert(names);
        }
    }
}

impl<'a> Visit<'a> for Reader<'_> {
    fn visit_item(&mut self, item: &'a Item) {
        let name = match item {
            Item::Const(item) => Some(&item.ident),
            Item::Enum(item) => Some(&item.ident),
            Item::Fn(item) => Some(&item.sig.ident),
            Item::Macro(item) => item.ident.as_ref(),
            Item::Mod(item) if item.content.is_some() && is_for_tests(&item.attrs) => return,
            Item::Static(item) => Some(&item.ident),
            Item::Struct(item) => Some(&item.ident),
            Item::Trait(item) => Some(&item.ident),
            Item::Type(item) => Some(&item.ident),
            Item::Use(item) => {
                let hands_on = !matches!(item.vis, syn::Visibility::Inherited);
                self.import(&item.tree, &Names::new(), hands_on);
                None
            }
            _ => None,
        };
        self.module.items.extend(name.map(Ident::to_string));
        visit::visit_item(self, item);
    }

    fn visit_path(&mut self, path: &'a syn::Path) {
        self.mention(path.segments.iter().map(|segment| segment.ident.to_string()).collect());
        visit::visit_path(self, path);
    }

    fn visit_macro(&mut self, called: &'a syn::Macro) {
        self.tokens(called.tokens.clone());
        visit::visit_macro(self, called);
    }
}

/// The functions of a file, those for tests included, with how many lines they have from the signature to the end.
pub(crate) fn functions(text: &str) -> Vec<(String, usize)> {
    let mut functions = Functions(Vec::new());
    functions.visit_file(&syn::parse_file(text).unwrap());
    functions.0
}

struct Functions(Vec<(String, usize)>);

impl Functions {
    fn add(&mut self, signature: &syn::Signature, whole: impl Spanned) {
        let lines = whole.span().end().line - signature.span().start().line + 1;
        self.0.push((signature.ident.to_string(), lines));
    }
}

impl<'a> Visit<'a> for Functions {
    fn visit_item_fn(&mut self, function: &'a syn::ItemFn) {
        self.add(&function.sig, function);
        visit::visit_item_fn(self, function);
    }

    fn visit_impl_item_fn(&mut self, function: &'a syn::ImplItemFn) {
        self.add(&function.sig, function);
        visit::visit_impl_item_fn(self, function);
    }

    fn visit_trait_item_fn(&mut self, function: &'a syn::TraitItemFn) {
        self.add(&function.sig, function);
        visit::visit_trait_item_fn(self, function);
    }
}

/// All Rust files below `folder`, those for tests included, without what was built.
pub(crate) fn files(folder: &Path) -> Vec<PathBuf> {
    let mut files = Vec::new();
    for entry in std::fs::read_dir(folder).unwrap() {
        let path = entry.unwrap().path();
        let name = path.file_name().unwrap().to_string_lossy();
        if path.is_dir() && name != "target" && !name.starts_with('.') {
            files.extend(self::files(&path));
        } else if path.extension().is_some_and(|extension| extension == "rs") {
            files.push(path);
        }
    }
    files
}
