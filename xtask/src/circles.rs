//! `cargo xtask circles`: the imports between files of each crate, which must not form a circle.
//!
//! A file imports another if it names an item that the other defines, however it is re-exported. It does not if it only
//! declares or re-exports, and tests are ignored. In [`FOLDERS`] a folder stands for its files, and is held to the same.

use std::collections::{BTreeMap, BTreeSet, HashSet};
use std::fs;
use std::mem;
use std::path::{Path, PathBuf};

use anyhow::{Context, Result, ensure};
use proc_macro2::{TokenStream, TokenTree};
use quote::ToTokens;
use serde_json::Value;
use syn::parse::{ParseStream, Parser};
use syn::punctuated::Punctuated;
use syn::visit::{self, Visit};
use syn::{
    Attribute, Expr, ImplItem, Item, ItemMod, ItemUse, Lit, Meta, MetaNameValue, Stmt, Token, UseTree, Visibility,
};

use crate::cargo::cargo;
use crate::process::output;
use crate::workspace::{ALONE, root};

/// The packages whose folders have no circle either.
const FOLDERS: [&str; 1] = ["armwire-host"];

/// Checks each target of each package.
///
/// # Errors
///
/// If a file cannot be read, or imports form a circle: their files, and the names that each imports.
pub(crate) fn check() -> Result<()> {
    let mut circles = BTreeSet::new();
    let mut files = 0;
    for workspace in [""].into_iter().chain(ALONE) {
        let metadata = output(&mut cargo(&format!(
            "metadata --no-deps --format-version 1 {workspace}"
        )))?;
        let metadata: Value = serde_json::from_str(&metadata)?;
        let packages = metadata["packages"].as_array().context("no packages")?;
        for package in packages {
            for target in package["targets"].as_array().into_iter().flatten() {
                let file = target["src_path"].as_str().context("a target without a file")?;
                let imports = Crate::read(Path::new(file))?.imports();
                files += imports.len();
                circles.extend(circles_of_files(&imports));
                if FOLDERS.iter().any(|name| package["name"] == *name) {
                    circles.extend(circles_of_folders(&imports));
                }
            }
        }
    }
    println!("{files} files");
    let circles: Vec<_> = circles.into_iter().collect();
    ensure!(circles.is_empty(), "imports in circles:\n\n{}", circles.join("\n"));
    Ok(())
}

/// The names that each file imports from each other file. Every file has an entry.
type Imports = BTreeMap<PathBuf, BTreeMap<PathBuf, BTreeSet<String>>>;

/// The circles of files, each as text.
fn circles_of_files(imports: &Imports) -> Vec<String> {
    let mut rest: BTreeSet<_> = imports.keys().collect();
    let mut circles = Vec::new();
    while let Some(first) = rest.pop_first() {
        let circle: BTreeSet<_> = reached(imports, first)
            .into_iter()
            .filter(|file| reached(imports, file).contains(first))
            .collect();
        rest.retain(|file| !circle.contains(file));
        let mut text = String::new();
        for from in &circle {
            for (to, names) in imports[*from].iter().filter(|(to, _)| circle.contains(to)) {
                let names: Vec<_> = names.iter().map(String::as_str).collect();
                text += &format!("{} -> {}: {}\n", shown(from), shown(to), names.join(", "));
            }
        }
        if !text.is_empty() {
            circles.push(format!("{} files:\n{text}", circle.len()));
        }
    }
    circles
}

/// The circles between the files and folders in each folder, as text.
fn circles_of_folders(imports: &Imports) -> Vec<String> {
    let folders: BTreeSet<_> = imports.keys().flat_map(|file| file.ancestors().skip(1)).collect();
    let mut circles = Vec::new();
    for folder in folders {
        // The entry of the folder that a file is, or lies in.
        let entry = |file: &Path| Some(folder.join(file.strip_prefix(folder).ok()?.components().next()?));
        let mut entries = Imports::new();
        for (from, to) in imports {
            let Some(from) = entry(from) else { continue };
            let imported = entries.entry(from.clone()).or_default();
            for (to, names) in to {
                if let Some(to) = entry(to).filter(|to| *to != from) {
                    imported.entry(to).or_default().extend(names.iter().cloned());
                }
            }
        }
        circles.extend(circles_of_files(&entries));
    }
    circles
}

/// The files that a file imports, directly or not.
fn reached<'a>(imports: &'a Imports, from: &'a Path) -> BTreeSet<&'a PathBuf> {
    let mut reached = BTreeSet::new();
    let mut open = vec![from];
    while let Some(file) = open.pop() {
        open.extend(
            imports[file]
                .keys()
                .filter(|to| reached.insert(*to))
                .map(PathBuf::as_path),
        );
    }
    reached
}

/// A file as seen from the workspace.
fn shown(file: &Path) -> impl std::fmt::Display {
    file.strip_prefix(root()).unwrap_or(file).display()
}

/// The modules of a target. The first is the root.
#[derive(Default)]
struct Crate {
    modules: Vec<Module>,
}

struct Module {
    file: PathBuf,
    /// Its parent, which is the module itself in the root.
    parent: usize,
    /// The names in its scope. Configurations may have different ones.
    names: BTreeMap<String, Vec<Name>>,
    /// The paths whose names are in its scope.
    globs: Vec<Vec<String>>,
    items: Vec<Item>,
}

enum Name {
    /// An item in the module's file. A path goes on behind a type only.
    Item {
        is_type: bool,
    },
    Module(usize),
    Import(Vec<String>),
}

const TYPE: Name = Name::Item { is_type: true };
const VALUE: Name = Name::Item { is_type: false };

/// What a path stands for.
enum Meaning {
    Item { file: PathBuf, name: String, is_type: bool },
    Module(usize),
}

impl Crate {
    /// Reads all modules of a target.
    fn read(root: &Path) -> Result<Self> {
        let mut all = Self::default();
        let folder = root.parent().context("a file without a folder")?;
        all.read_file(root, folder, 0)?;
        Ok(all)
    }

    /// Reads a module from its file. The files of its modules are in `folder`.
    fn read_file(&mut self, file: &Path, folder: &Path, parent: usize) -> Result<usize> {
        let text = fs::read_to_string(file).with_context(|| format!("cannot read {}", file.display()))?;
        let parsed = syn::parse_file(&text).with_context(|| format!("cannot parse {}", file.display()))?;
        self.read_module(parsed.items, file, folder, parent)
    }

    fn read_module(&mut self, items: Vec<Item>, file: &Path, folder: &Path, parent: usize) -> Result<usize> {
        let nth = self.modules.len();
        self.modules.push(Module {
            file: file.to_owned(),
            parent,
            names: BTreeMap::new(),
            globs: Vec::new(),
            items: Vec::new(),
        });
        for item in items.into_iter().filter(|item| !is_for_tests(item)) {
            match item {
                Item::Mod(module) => {
                    let name = Name::Module(self.read_submodule(&module, file, folder, nth)?);
                    self.modules[nth].define(&module.ident, name);
                }
                item => {
                    let module = &mut self.modules[nth];
                    module.define_all(&item);
                    Uses(module).visit_item(&item);
                    module.items.push(item);
                }
            }
        }
        Ok(nth)
    }

    fn read_submodule(&mut self, module: &ItemMod, file: &Path, folder: &Path, parent: usize) -> Result<usize> {
        let name = module.ident.to_string();
        let folder = folder.join(&name);
        if let Some((_, items)) = &module.content {
            return self.read_module(items.clone(), file, &folder, parent);
        }
        if let Some(path) = path_attribute(&module.attrs) {
            let file = file.with_file_name(path).canonicalize()?;
            return self.read_file(&file, &file.with_file_name(""), parent);
        }
        let beside = folder.with_extension("rs");
        let file = if beside.exists() { beside } else { folder.join("mod.rs") };
        self.read_file(&file, &folder, parent)
    }

    /// What the files import from each other.
    fn imports(&self) -> Imports {
        let mut imports = Imports::new();
        for (nth, module) in self.modules.iter().enumerate() {
            let mut paths = Paths::default();
            module.items.iter().for_each(|item| paths.visit_item(item));
            let imported = imports.entry(module.file.clone()).or_default();
            for path in paths.0 {
                for meaning in self.meanings(nth, &path, &mut HashSet::new()) {
                    if let Meaning::Item { file, name, .. } = meaning
                        && file != module.file
                    {
                        imported.entry(file).or_default().insert(name);
                    }
                }
            }
        }
        imports
    }

    /// What a path in a module stands for; nothing if it is another crate's, or a local name. `asked` has the questions
    /// that wait for the answer to this one: imports may be circular.
    fn meanings(&self, module: usize, path: &[String], asked: &mut HashSet<(usize, Vec<String>)>) -> Vec<Meaning> {
        let Some((first, rest)) = path.split_first() else {
            return vec![Meaning::Module(module)];
        };
        let start = match first.as_str() {
            "crate" => Some(0),
            "self" => Some(module),
            "super" => Some(self.modules[module].parent),
            _ => None,
        };
        if let Some(start) = start {
            return self.meanings(start, rest, asked);
        }
        if !asked.insert((module, path.to_vec())) {
            return Vec::new();
        }
        let Module { file, names, globs, .. } = &self.modules[module];
        let mut found = Vec::new();
        for name in names.get(first).into_iter().flatten() {
            match name {
                Name::Item { is_type } => found.push(Meaning::Item {
                    is_type: *is_type,
                    file: file.clone(),
                    name: first.clone(),
                }),
                Name::Module(module) => found.push(Meaning::Module(*module)),
                Name::Import(path) => found.extend(self.meanings(module, path, asked)),
            }
        }
        if found.is_empty() {
            for glob in globs {
                for meaning in self.meanings(module, glob, asked) {
                    if let Meaning::Module(from) = meaning {
                        found.extend(self.meanings(from, &path[..1], asked));
                    }
                }
            }
        }
        asked.remove(&(module, path.to_vec()));
        let within = |meaning| match meaning {
            Meaning::Module(module) => self.meanings(module, rest, asked),
            Meaning::Item { is_type: false, .. } if !rest.is_empty() => Vec::new(),
            item => vec![item],
        };
        found.into_iter().flat_map(within).collect()
    }
}

impl Module {
    fn define(&mut self, name: &impl ToString, meaning: Name) {
        self.names.entry(name.to_string()).or_default().push(meaning);
    }

    /// Defines the names of an item.
    fn define_all(&mut self, item: &Item) {
        match item {
            Item::Const(item) => self.define(&item.ident, VALUE),
            Item::Enum(item) => self.define(&item.ident, TYPE),
            Item::Fn(item) => self.define(&item.sig.ident, VALUE),
            Item::Static(item) => self.define(&item.ident, VALUE),
            Item::Struct(item) => self.define(&item.ident, TYPE),
            Item::Trait(item) => self.define(&item.ident, TYPE),
            Item::Type(item) => self.define(&item.ident, TYPE),
            Item::Union(item) => self.define(&item.ident, TYPE),
            Item::Macro(item) => match &item.ident {
                Some(name) => self.define(name, VALUE),
                None => self.define_in(item.mac.tokens.clone()),
            },
            _ => {}
        }
    }

    /// Defines what the arguments of a macro seem to: the names behind keywords.
    fn define_in(&mut self, tokens: TokenStream) {
        const KEYWORDS: [&str; 8] = ["const", "enum", "fn", "static", "struct", "trait", "type", "union"];
        let mut is_keyword = false;
        for token in tokens {
            if let TokenTree::Ident(name) = token {
                if is_keyword {
                    self.define(&name, TYPE);
                }
                is_keyword = KEYWORDS.contains(&name.to_string().as_str());
            }
        }
    }
}

/// Adds the names that a module imports. Those of a function count as the module's.
struct Uses<'a>(&'a mut Module);

impl Visit<'_> for Uses<'_> {
    fn visit_item_use(&mut self, item: &ItemUse) {
        for (name, path) in used(item) {
            match name {
                Some(name) => self.0.define(&name, Name::Import(path)),
                None => self.0.globs.push(path),
            }
        }
    }
}

/// The paths that a `use` imports, and the name that each gets; `None` if it is a glob.
fn used(item: &ItemUse) -> Vec<(Option<String>, Vec<String>)> {
    fn walk(tree: &UseTree, path: &[String], found: &mut Vec<(Option<String>, Vec<String>)>) {
        let with = |name: &syn::Ident| match name.to_string() {
            name if name == "self" && !path.is_empty() => path.to_vec(),
            name => [path, &[name]].concat(),
        };
        match tree {
            UseTree::Path(tree) => walk(&tree.tree, &with(&tree.ident), found),
            UseTree::Name(tree) => {
                let path = with(&tree.ident);
                found.push((path.last().cloned(), path));
            }
            UseTree::Rename(tree) => found.push((Some(tree.rename.to_string()), with(&tree.ident))),
            UseTree::Glob(_) => found.push((None, path.to_vec())),
            UseTree::Group(tree) => tree.items.iter().for_each(|tree| walk(tree, path, found)),
        }
    }
    let mut found = Vec::new();
    if item.leading_colon.is_none() {
        walk(&item.tree, &[], &mut found);
    }
    found
}

/// Collects the paths in items.
#[derive(Default)]
struct Paths(Vec<Vec<String>>);

impl Paths {
    /// Collects what looks like a path in the arguments of a macro. The name of a field does not.
    fn add_tokens(&mut self, tokens: TokenStream) {
        let mut path = Vec::new();
        let mut before = String::new();
        for token in tokens {
            match token {
                TokenTree::Ident(name) => {
                    if before != "::" {
                        self.0.push(mem::take(&mut path));
                    }
                    if before != "." {
                        path.push(name.to_string());
                    }
                }
                TokenTree::Group(group) => self.add_tokens(group.stream()),
                TokenTree::Punct(punct) => {
                    before.push(punct.as_char());
                    continue;
                }
                TokenTree::Literal(_) => {}
            }
            before.clear();
        }
        self.0.push(path);
    }
}

impl<'ast> Visit<'ast> for Paths {
    fn visit_item(&mut self, item: &'ast Item) {
        if !is_for_tests(item) {
            visit::visit_item(self, item);
        }
    }

    fn visit_impl_item(&mut self, item: &'ast ImplItem) {
        if !is_for_tests(item) {
            visit::visit_impl_item(self, item);
        }
    }

    fn visit_stmt(&mut self, statement: &'ast Stmt) {
        if !is_for_tests(statement) {
            visit::visit_stmt(self, statement);
        }
    }

    fn visit_item_use(&mut self, item: &'ast ItemUse) {
        if matches!(item.vis, Visibility::Inherited) {
            self.0.extend(used(item).into_iter().map(|(_, path)| path));
        }
    }

    /// A path in it is a module, and may also name a function.
    fn visit_visibility(&mut self, _: &'ast Visibility) {}

    fn visit_path(&mut self, path: &'ast syn::Path) {
        if path.leading_colon.is_none() {
            let names = path.segments.iter().map(|segment| segment.ident.to_string());
            self.0.push(names.collect());
        }
        visit::visit_path(self, path);
    }

    fn visit_macro(&mut self, invocation: &'ast syn::Macro) {
        self.visit_path(&invocation.path);
        self.add_tokens(invocation.tokens.clone());
    }

    fn visit_meta_list(&mut self, list: &'ast syn::MetaList) {
        self.visit_path(&list.path);
        self.add_tokens(list.tokens.clone());
    }
}

/// The file that `#[path = "…"]` names.
fn path_attribute(attributes: &[Attribute]) -> Option<String> {
    attributes.iter().find_map(|attribute| match &attribute.meta {
        Meta::NameValue(MetaNameValue {
            path,
            value: Expr::Lit(value),
            ..
        }) if path.is_ident("path") => match &value.lit {
            Lit::Str(text) => Some(text.value()),
            _ => None,
        },
        _ => None,
    })
}

/// Returns true if an item or statement is compiled for tests only.
fn is_for_tests(item: &impl ToTokens) -> bool {
    let attributes = |input: ParseStream| {
        let attributes = input.call(Attribute::parse_outer)?;
        input.parse::<TokenStream>()?;
        Ok(attributes)
    };
    let attributes: Vec<Attribute> = attributes.parse2(item.to_token_stream()).unwrap_or_default();
    let mut conditions = attributes.iter().filter(|attribute| attribute.path().is_ident("cfg"));
    conditions.any(|attribute| attribute.parse_args().is_ok_and(|condition| needs_test(&condition)))
}

/// Returns true if a condition is false without `test`.
fn needs_test(condition: &Meta) -> bool {
    let Meta::List(list) = condition else {
        return condition.path().is_ident("test");
    };
    let parts = list.parse_args_with(Punctuated::<Meta, Token![,]>::parse_terminated);
    let parts = parts.unwrap_or_default();
    match list.path.get_ident().map(ToString::to_string).as_deref() {
        Some("all") => parts.iter().any(needs_test),
        Some("any") => parts.iter().all(needs_test),
        _ => false,
    }
}

#[cfg(test)]
mod tests {
    use std::env::temp_dir;
    use std::process;

    use super::*;
    use crate::files::empty_folder;

    /// The imports of a crate with these files.
    fn imports(name: &str, files: &[(&str, &str)]) -> Imports {
        let folder = temp_dir().join(format!("armwire-circles-{name}-{}", process::id()));
        empty_folder(&folder).unwrap();
        for (file, text) in files {
            let file = folder.join(file);
            fs::create_dir_all(file.parent().unwrap()).unwrap();
            fs::write(file, text).unwrap();
        }
        let read = Crate::read(&folder.join("lib.rs")).unwrap().imports();
        fs::remove_dir_all(&folder).unwrap();
        let relative = |file: &PathBuf| file.strip_prefix(&folder).unwrap().to_owned();
        let names = |to: BTreeMap<_, _>| to.into_iter().map(|(to, names)| (relative(&to), names)).collect();
        read.into_iter()
            .map(|(from, to)| (relative(&from), names(to)))
            .collect()
    }

    #[test]
    fn circle_is_found_behind_re_exports() {
        let imports = imports(
            "re-exports",
            &[
                ("lib.rs", "mod a; mod b; mod c; pub use a::A;"),
                ("a.rs", "use crate::b; pub struct A(Option<Box<b::B>>);"),
                ("b/mod.rs", "mod inner; pub(crate) use inner::B;"),
                (
                    "b/inner.rs",
                    "pub(crate) struct B; impl B { fn f() -> String { format!(\"{}\", crate::A::g()) } }",
                ),
                ("c.rs", "use crate::{A, b::B}; fn f(a: A, b: B) {}"),
            ],
        );
        assert_eq!(
            circles_of_files(&imports),
            ["2 files:\na.rs -> b/inner.rs: B\nb/inner.rs -> a.rs: A\n"]
        );
    }

    #[test]
    fn declaration_re_export_and_test_are_no_imports() {
        let imports = imports(
            "none",
            &[
                ("lib.rs", "mod a; pub use a::{Child, a}; pub struct Root;"),
                (
                    "a/mod.rs",
                    "mod child; pub use child::Child; pub struct Shared(crate::Root); pub fn a() {}
                     #[cfg(all(test, unix))] mod tests { use super::child::Child; }",
                ),
                (
                    "a/child.rs",
                    "use super::Shared; pub(in crate::a) struct Child(Shared, crate::a::Shared);",
                ),
            ],
        );
        assert_eq!(circles_of_files(&imports), [""; 0]);
        assert_eq!(imports[Path::new("a/child.rs")].len(), 1);
        assert_eq!(imports[Path::new("a/mod.rs")].len(), 1);
    }

    #[test]
    fn folders_may_form_a_circle_without_files() {
        let imports = imports(
            "folders",
            &[
                ("lib.rs", "mod a; mod b;"),
                ("a/mod.rs", "mod low; mod high; pub use low::Low;"),
                ("a/low.rs", "pub struct Low;"),
                ("a/high.rs", "struct High(crate::b::Middle);"),
                ("b/mod.rs", "pub struct Middle(crate::a::Low);"),
            ],
        );
        assert_eq!(circles_of_files(&imports), [""; 0]);
        assert_eq!(
            circles_of_folders(&imports),
            ["2 files:\na -> b: Middle\nb -> a: Low\n"]
        );
    }
}
