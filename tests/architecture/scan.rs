//! A reader of Rust source that understands just enough to find the paths it names: comments and
//! literals are dropped, `use` groups are expanded, and inline modules are followed.

/// A piece of source that is neither comment, literal nor white space.
#[derive(Debug, Clone, PartialEq)]
pub enum Token {
    /// A name or keyword.
    Name(String),
    /// The separator `::` of a path.
    Separator,
    /// Any other character, by itself.
    Sign(char),
}

/// A path that the source names.
#[derive(Debug, Clone, PartialEq)]
pub struct Path {
    /// Line number, from 1.
    pub line: usize,
    /// Names from left to right.
    pub names: Vec<String>,
    /// Inline modules that contain it.
    pub modules: Vec<String>,
    /// Whether it is under `#[cfg(test)]`.
    pub in_tests: bool,
    /// Whether `!` follows, as in a call of a macro.
    pub is_macro: bool,
    /// Present in a `use`.
    pub import: Option<Import>,
}

/// Properties of a `use`: its visibility and its new name.
#[derive(Debug, Clone, PartialEq)]
pub struct Import {
    /// Whether others may use the name from here.
    pub is_public: bool,
    /// The name behind `as`.
    pub alias: Option<String>,
}

fn is_name(c: char) -> bool {
    c.is_alphanumeric() || c == '_'
}

/// Tokens with their line numbers.
pub fn tokens(text: &str) -> Vec<(usize, Token)> {
    let source: Vec<char> = text.chars().collect();
    let at = |i: usize| source.get(i).copied().unwrap_or('\0');
    let (mut i, mut line, mut found) = (0, 1, Vec::new());
    while i < source.len() {
        let start = i;
        match at(i) {
            '/' if at(i + 1) == '/' => {
                while i < source.len() && at(i) != '\n' {
                    i += 1;
                }
            }
            '/' if at(i + 1) == '*' => {
                let mut depth = 0;
                loop {
                    match (at(i), at(i + 1)) {
                        ('/', '*') => (depth, i) = (depth + 1, i + 2),
                        ('*', '/') => (depth, i) = (depth - 1, i + 2),
                        _ => i += 1,
                    }
                    if depth == 0 || i >= source.len() {
                        break;
                    }
                }
            }
            '"' => i = after_string(&source, i),
            // A character literal (`'a'`, `'\n'`), or else a lifetime (`'a`).
            '\'' if at(i + 1) == '\\' => {
                i += 3;
                while i < source.len() && at(i) != '\'' {
                    i += 1;
                }
                i += 1;
            }
            '\'' if at(i + 2) == '\'' => i += 3,
            ':' if at(i + 1) == ':' => {
                found.push((line, Token::Separator));
                i += 2;
            }
            c if is_name(c) => {
                while is_name(at(i)) {
                    i += 1;
                }
                let name: String = source[start..i].iter().collect();
                let raw = matches!(name.as_str(), "r" | "br" | "cr") && matches!(at(i), '"' | '#');
                if raw && (at(i) == '"' || matches!(at(i + 1), '"' | '#')) {
                    i = after_raw_string(&source, i);
                } else {
                    found.push((line, Token::Name(name)));
                }
            }
            c => {
                if !c.is_whitespace() {
                    found.push((line, Token::Sign(c)));
                }
                i += 1;
            }
        }
        line += source[start..i.min(source.len())]
            .iter()
            .filter(|c| **c == '\n')
            .count();
    }
    found
}

fn after_string(source: &[char], open: usize) -> usize {
    let mut i = open + 1;
    while i < source.len() && source[i] != '"' {
        i += if source[i] == '\\' { 2 } else { 1 };
    }
    i + 1
}

fn after_raw_string(source: &[char], first_hash_or_quote: usize) -> usize {
    let n_hashes = source[first_hash_or_quote..]
        .iter()
        .take_while(|c| **c == '#')
        .count();
    let mut i = first_hash_or_quote + n_hashes + 1;
    while i < source.len() {
        if source[i] == '"' && source[i + 1..].iter().take_while(|c| **c == '#').count() >= n_hashes
        {
            return i + 1 + n_hashes;
        }
        i += 1;
    }
    i
}

/// Every path of a source text.
pub fn paths(text: &str) -> Vec<Path> {
    let tokens = tokens(text);
    let mut reader = Reader {
        tokens: &tokens,
        at: 0,
        import: None,
        found: Vec::new(),
    };
    // Open braces. Those of an inline module have its name and whether it is for tests.
    let mut braces: Vec<Option<(String, bool)>> = Vec::new();
    let mut test_next = false;
    while let Some((line, token)) = reader.peek(0) {
        let (line, token) = (*line, token.clone());
        match token {
            Token::Sign('#') => {
                test_next |= reader.is_cfg_test();
                reader.at += 1;
            }
            Token::Name(word)
                if word == "mod" && matches!(reader.peek(2), Some((_, Token::Sign('{')))) =>
            {
                let Some((_, Token::Name(name))) = reader.peek(1).cloned() else {
                    unreachable!("a module has a name")
                };
                braces.push(Some((name, test_next)));
                test_next = false;
                reader.at += 3;
            }
            Token::Name(word) if word == "use" => {
                reader.import = Some(reader.is_public());
                reader.at += 1;
            }
            Token::Name(_) => {
                let modules = braces
                    .iter()
                    .flatten()
                    .map(|(name, _)| name.clone())
                    .collect::<Vec<_>>();
                let in_tests = braces.iter().flatten().any(|(_, test)| *test)
                    || (test_next && reader.import.is_some());
                let first = reader.found.len();
                reader.path(Vec::new());
                for path in &mut reader.found[first..] {
                    path.line = line;
                    path.modules.clone_from(&modules);
                    path.in_tests = in_tests;
                }
            }
            Token::Sign('{') => {
                braces.push(None);
                test_next = false;
                reader.at += 1;
            }
            Token::Sign('}') => {
                braces.pop();
                reader.at += 1;
            }
            Token::Sign(';') => {
                test_next = false;
                reader.import = None;
                reader.at += 1;
            }
            Token::Separator | Token::Sign(_) => reader.at += 1,
        }
    }
    reader.found
}

struct Reader<'a> {
    tokens: &'a [(usize, Token)],
    at: usize,
    /// In a `use`: whether it is public.
    import: Option<bool>,
    found: Vec<Path>,
}

impl Reader<'_> {
    fn peek(&self, ahead: usize) -> Option<&(usize, Token)> {
        self.tokens.get(self.at + ahead)
    }

    fn sees(&self, ahead: usize, sign: char) -> bool {
        matches!(self.peek(ahead), Some((_, Token::Sign(c))) if *c == sign)
    }

    /// Whether the reader is at `#[cfg(test)]` or `#[cfg(all(test, …))]`.
    fn is_cfg_test(&self) -> bool {
        let name = |ahead: usize| match self.peek(ahead) {
            Some((_, Token::Name(name))) => name.as_str(),
            _ => "",
        };
        name(2) == "cfg" && (name(4) == "test" || (name(4) == "all" && name(6) == "test"))
    }

    /// Whether `pub` or `pub(…)` stands before the present token.
    fn is_public(&self) -> bool {
        let mut before = self.tokens[..self.at].iter().rev().map(|(_, token)| token);
        let mut token = before.next();
        if token == Some(&Token::Sign(')')) {
            token = before
                .by_ref()
                .find(|token| **token == Token::Sign('('))
                .and(before.next());
        }
        token == Some(&Token::Name("pub".to_owned()))
    }

    /// Reads `a::b::{c, d::e}` from a name on; `before` holds the names to the left.
    fn path(&mut self, before: Vec<String>) {
        let mut names = before;
        loop {
            let Some((_, Token::Name(name))) = self.peek(0).cloned() else {
                if self.import.is_some() && self.sees(0, '*') {
                    names.push("*".to_owned());
                    self.at += 1;
                    self.push(names);
                }
                return;
            };
            names.push(name);
            self.at += 1;
            if self
                .peek(0)
                .is_none_or(|(_, token)| *token != Token::Separator)
            {
                break;
            }
            self.at += 1;
            if self.sees(0, '{') {
                self.at += 1;
                while !self.sees(0, '}') && self.peek(0).is_some() {
                    match self.peek(0) {
                        Some((_, Token::Name(_) | Token::Sign('*'))) => self.path(names.clone()),
                        _ => self.at += 1,
                    }
                }
                self.at += 1;
                return;
            }
        }
        self.push(names);
    }

    fn push(&mut self, names: Vec<String>) {
        let is_macro = self.sees(0, '!') && !self.sees(1, '=');
        let import = self.import.map(|is_public| Import {
            is_public,
            alias: self.alias(),
        });
        self.found.push(Path {
            line: 0,
            names,
            modules: Vec::new(),
            in_tests: false,
            is_macro,
            import,
        });
    }

    /// New name of an import, if `as name` follows.
    fn alias(&mut self) -> Option<String> {
        match (self.peek(0).cloned(), self.peek(1).cloned()) {
            (Some((_, Token::Name(word))), Some((_, Token::Name(alias)))) if word == "as" => {
                self.at += 2;
                Some(alias)
            }
            _ => None,
        }
    }
}

/// The path from the crate's root that `path` means in the file module `file_module`; `None` if it
/// is not relative to the crate.
pub fn absolute(path: &Path, file_module: &[String]) -> Option<Vec<String>> {
    let first = path.names.first()?.as_str();
    let n_supers = path
        .names
        .iter()
        .take_while(|name| *name == "super")
        .count();
    if first == "crate" {
        return Some(path.names[1..].to_vec());
    }
    if n_supers == 0 {
        return None;
    }
    let mut here: Vec<String> = file_module.iter().chain(&path.modules).cloned().collect();
    here.truncate(here.len().saturating_sub(n_supers));
    here.extend(path.names[n_supers..].iter().cloned());
    Some(here)
}
