//! Circles of files: files of one crate that use each other, so that none can be read without the others.
//!
//! A module that re-exports its children (`pub use child::Name`) only wires them: such an arrow does not count, and who
//! uses the name uses the child. Code for tests is left out.

use std::collections::{BTreeMap, BTreeSet};

use crate::scan::{self, Path, Token};

type Module = Vec<String>;

/// Files of a crate by their modules, and the arrows between them.
struct Files<'a> {
    paths: BTreeMap<Module, Vec<Path>>,
    /// Absolute paths of the names that a module imports.
    imports: BTreeMap<Module, BTreeMap<String, Module>>,
    files: &'a BTreeMap<Module, (String, String)>,
}

/// Every circle of a crate's files, each as the sorted names of its modules.
///
/// - `files`: name and text of each file, by its module
pub fn circles(mut files: BTreeMap<Module, (String, String)>) -> Vec<Vec<String>> {
    let tests = test_modules(&files);
    files.retain(|module, _| !(1..=module.len()).any(|n| tests.contains(&module[..n])));
    let arrows = Files::new(&files).arrows();
    let reached: BTreeMap<&Module, BTreeSet<&Module>> = files
        .keys()
        .map(|module| (module, reachable(module, &arrows)))
        .collect();
    let mut circles = BTreeSet::new();
    for (module, others) in &reached {
        let circle: Vec<String> = others
            .iter()
            .filter(|other| **other != *module && reached[**other].contains(*module))
            .chain(std::iter::once(module))
            .map(|module| name_of(module))
            .collect::<BTreeSet<_>>()
            .into_iter()
            .collect();
        if circle.len() > 1 {
            circles.insert(circle);
        }
    }
    circles.into_iter().collect()
}

fn name_of(module: &Module) -> String {
    if module.is_empty() {
        "lib".to_owned()
    } else {
        module.join("::")
    }
}

fn reachable<'a>(
    from: &'a Module,
    arrows: &'a BTreeMap<Module, BTreeSet<Module>>,
) -> BTreeSet<&'a Module> {
    let (mut found, mut open) = (BTreeSet::new(), vec![from]);
    while let Some(module) = open.pop() {
        for next in arrows.get(module).into_iter().flatten() {
            if found.insert(next) {
                open.push(next);
            }
        }
    }
    found
}

/// Modules that are declared as `#[cfg(test)] mod name;`.
fn test_modules(files: &BTreeMap<Module, (String, String)>) -> BTreeSet<Module> {
    let mut found = BTreeSet::new();
    for (module, (_, text)) in files {
        let tokens: Vec<Token> = scan::tokens(text)
            .into_iter()
            .map(|(_, token)| token)
            .collect();
        let name = |at: usize| match tokens.get(at) {
            Some(Token::Name(name)) => name.as_str(),
            _ => "",
        };
        for at in 0..tokens.len() {
            // # [ cfg ( test ) ] mod name ;
            let is_test = tokens[at] == Token::Sign('#')
                && name(at + 2) == "cfg"
                && name(at + 4) == "test"
                && name(at + 7) == "mod"
                && tokens.get(at + 9) == Some(&Token::Sign(';'));
            if is_test {
                let mut declared = module.clone();
                declared.push(name(at + 8).to_owned());
                found.insert(declared);
            }
        }
    }
    found
}

impl<'a> Files<'a> {
    fn new(files: &'a BTreeMap<Module, (String, String)>) -> Self {
        let paths: BTreeMap<Module, Vec<Path>> = files
            .iter()
            .map(|(module, (_, text))| {
                let used = scan::paths(text).into_iter().filter(|path| !path.in_tests);
                (module.clone(), used.collect())
            })
            .collect();
        let mut all = Self {
            paths,
            imports: BTreeMap::new(),
            files,
        };
        for (module, paths) in &all.paths {
            let mut names = BTreeMap::new();
            for path in paths.iter().filter(|path| path.modules.is_empty()) {
                let Some(import) = &path.import else { continue };
                let Some(mut absolute) = all.absolute(path, module) else {
                    continue;
                };
                absolute.retain(|name| name != "self");
                let own = absolute.last().cloned().unwrap_or_default();
                names.insert(import.alias.clone().unwrap_or(own), absolute);
            }
            all.imports.insert(module.clone(), names);
        }
        all
    }

    /// A path from the crate's root; also one that begins with a child of its module.
    fn absolute(&self, path: &Path, module: &Module) -> Option<Module> {
        if let Some(absolute) = scan::absolute(path, module) {
            return Some(absolute);
        }
        let here: Module = module.iter().chain(&path.modules).cloned().collect();
        let rest = match path.names.first()?.as_str() {
            "self" => &path.names[1..],
            _ => &path.names[..],
        };
        let absolute: Module = here.iter().chain(rest).cloned().collect();
        let child = &absolute[..(here.len() + 1).min(absolute.len())];
        (rest.len() < path.names.len() || self.files.contains_key(child)).then_some(absolute)
    }

    /// The file in which a path ends, through the re-exports on its way.
    fn resolve(&self, path: &[String], depth: usize) -> Option<Module> {
        let n = (0..=path.len())
            .rev()
            .find(|n| self.files.contains_key(&path[..*n]))?;
        let module = path[..n].to_vec();
        let import = path.get(n).and_then(|name| self.imports[&module].get(name));
        match import {
            Some(import) if depth < 8 && !import.starts_with(path) => {
                let further: Module = import.iter().chain(&path[n + 1..]).cloned().collect();
                self.resolve(&further, depth + 1)
            }
            _ => Some(module),
        }
    }

    fn arrows(&self) -> BTreeMap<Module, BTreeSet<Module>> {
        let mut arrows: BTreeMap<Module, BTreeSet<Module>> = BTreeMap::new();
        for (module, paths) in &self.paths {
            for path in paths {
                let is_named = path.names.len() > 1 || path.import.is_some();
                let Some(mut absolute) = self.absolute(path, module).filter(|_| is_named) else {
                    continue;
                };
                if absolute.last().is_some_and(|name| name == "*") {
                    absolute.pop();
                }
                let Some(target) = self.resolve(&absolute, 0) else {
                    continue;
                };
                let is_public = path.import.as_ref().is_some_and(|import| import.is_public);
                let is_wiring = is_public && target.starts_with(module);
                if target != *module && !is_wiring {
                    arrows.entry(module.clone()).or_default().insert(target);
                }
            }
        }
        arrows
    }
}
