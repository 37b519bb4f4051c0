//! Settings in the documents: keys exist, defaults are the program's, and blocks of TOML are valid.

use std::collections::BTreeSet;

use cardiotwin_schemas::ranges::Ranges;
use cardiotwin_schemas::settings::Settings;
use regex::Regex;
use serde_json::{Map, Value};

use super::{documents, lines, name_of, read, root};

/// Reads one of the JSON Schemas in schemas/json.
fn schema(name: &str) -> Value {
    let file = root().join(format!("schemas/json/{name}.schema.json"));
    serde_json::from_str(&read(&file)).expect("a JSON Schema")
}

/// The schema to which a property refers, through `$ref`, `anyOf` with null, and the like.
fn resolve<'a>(whole: &'a Value, part: &'a Value) -> &'a Value {
    if let Some(name) = part
        .get("$ref")
        .and_then(Value::as_str)
        .and_then(|path| path.rsplit('/').next())
    {
        return resolve(whole, &whole["$defs"][name]);
    }
    match part.get("anyOf").and_then(Value::as_array) {
        Some(choices) => choices
            .iter()
            .find(|choice| choice.get("type") != Some(&Value::from("null")))
            .map_or(part, |choice| resolve(whole, choice)),
        None => part,
    }
}

/// Whether a schema has a key: a path through its tables, or any path below a table of free names.
fn knows(whole: &Value, part: &Value, path: &[String]) -> bool {
    let part = resolve(whole, part);
    let Some((first, rest)) = path.split_first() else {
        return true;
    };
    if let Some(property) = part.get("properties").and_then(|all| all.get(first)) {
        return knows(whole, property, rest);
    }
    match part.get("additionalProperties") {
        Some(Value::Object(free)) => knows(whole, &Value::Object(free.clone()), rest),
        Some(Value::Bool(any)) => *any,
        // A table that the schema leaves open, such as a patient's settings.
        None => part.get("properties").is_none() && part.get("type").is_none(),
        Some(_) => false,
    }
}

/// Whether the program has a setting or a table of settings of this name.
fn is_setting(cohort: &Value, key: &str) -> bool {
    let path: Vec<String> = key.split('.').map(str::to_owned).collect();
    knows(cohort, cohort, &path)
}

/// All settings of a schema. A table of free names counts as one setting.
fn leaves(whole: &Value, part: &Value, path: &str, found: &mut BTreeSet<String>) {
    let part = resolve(whole, part);
    match part.get("properties").and_then(Value::as_object) {
        Some(properties) => {
            for (key, property) in properties {
                let path = if path.is_empty() {
                    key.clone()
                } else {
                    format!("{path}.{key}")
                };
                leaves(whole, property, &path, found);
            }
        }
        None => {
            found.insert(path.to_owned());
        }
    }
}

/// Each dotted key in code, fenced or inline, that begins with a table of the cohort's settings is
/// a setting.
#[test]
fn settings_exist() {
    let cohort = schema("cohort");
    let key = Regex::new(
        r"(?:^|[^\w./-])((?:solver|step1|step2|step3|posterior|verification|workflow|executor)(?:\.[A-Za-z_]\w*)+)",
    )
    .expect("a regular expression");
    let inline = Regex::new(r"`([^`]+)`").expect("a regular expression");
    let mut n_keys = 0;
    let mut problems = Vec::new();
    for file in documents() {
        // The changelog describes past settings.
        if name_of(&file) == "CHANGELOG.md" {
            continue;
        }
        let text = read(&file);
        let mut code: Vec<(usize, String)> = lines(&text, true)
            .into_iter()
            .map(|(number, line)| (number, line.to_owned()))
            .collect();
        for (number, line) in lines(&text, false) {
            code.extend(
                inline
                    .captures_iter(line)
                    .map(|found| (number, found[1].to_owned())),
            );
        }
        // A worked change adds a setting that the program does not have.
        let is_added = |line: &str| name_of(&file) == "CONTRIBUTING.md" && line.starts_with('+');
        for (number, line) in code {
            if is_added(&line) {
                continue;
            }
            for found in key.captures_iter(&line) {
                let key = &found[1];
                // Names such as `step1.md` and `executor.rs` are files.
                if [".md", ".rs", ".toml", ".json"]
                    .iter()
                    .any(|end| key.ends_with(end))
                {
                    continue;
                }
                n_keys += 1;
                if !is_setting(&cohort, key) {
                    problems.push(format!("{}:{number}: {key}", file.display()));
                }
            }
        }
    }
    assert!(
        problems.is_empty(),
        "settings that the program does not have:\n  {}",
        problems.join("\n  ")
    );
    assert!(n_keys > 100, "only {n_keys} settings were found");
}

/// A key with the default and the range that a table of a page gives for it.
struct Row {
    place: String,
    key: String,
    default: String,
    /// Cell of the column `allowed`, where the table has one.
    allowed: String,
}

/// Rows of all tables with a first column `key` or ``key of `TABLE` `` and a column `default`.
fn rows(file: &std::path::Path) -> Vec<Row> {
    let prefix = Regex::new(r"^key of `([\w.]+)`$").expect("a regular expression");
    let code = Regex::new(r"`([^`]+)`").expect("a regular expression");
    let text = read(file);
    let mut found = Vec::new();
    let mut columns: Option<(String, usize, Option<usize>)> = None;
    let mut inside = false;
    for (number, line) in lines(&text, false) {
        if !line.starts_with('|') {
            inside = false;
            columns = None;
            continue;
        }
        let cells: Vec<&str> = line.trim_matches('|').split('|').map(str::trim).collect();
        if !inside {
            inside = true;
            let before = match prefix.captures(cells[0]) {
                Some(of) => Some(format!("{}.", &of[1])),
                None => (cells[0] == "key").then(String::new),
            };
            let column = |name: &str| cells.iter().position(|cell| *cell == name);
            columns = before
                .zip(column("default"))
                .map(|(before, default)| (before, default, column("allowed")));
        } else if let Some((before, column, allowed)) = &columns
            && let Some(key) = code.captures(cells[0])
        {
            let cell = cells.get(*column).copied().unwrap_or_default();
            found.push(Row {
                place: format!("{}:{number}", file.display()),
                key: format!("{before}{}", &key[1]),
                default: code
                    .captures(cell)
                    .map_or_else(|| cell.to_owned(), |value| value[1].to_owned()),
                allowed: allowed
                    .and_then(|column| cells.get(column))
                    .map_or_else(String::new, |cell| (*cell).to_owned()),
            });
        }
    }
    found
}

/// The default settings with one key changed, as in a cohort's file.
fn with(key: &str, value: Value) -> Result<Settings, serde_json::Error> {
    let mut whole = serde_json::to_value(Settings::default())?;
    let mut place = &mut whole;
    for name in key.split('.') {
        if place.is_null() {
            *place = Value::Object(Map::new());
        }
        place = &mut place[name];
    }
    *place = value;
    serde_json::from_value(whole)
}

/// Setting a key to the default that a page gives for it changes nothing.
#[test]
fn defaults_are_the_programs() {
    let cohort = schema("cohort");
    let usual = Settings::default();
    let settings = serde_json::to_value(&usual).expect("settings are JSON");
    let mut problems = Vec::new();
    let mut told = BTreeSet::new();
    for file in documents() {
        for Row {
            place,
            key,
            default,
            ..
        } in rows(&file)
        {
            if name_of(&file) == "settings.md" {
                told.insert(key.clone());
            }
            let table = key.split('.').next().unwrap_or_default();
            if settings.get(table).is_none() {
                if !is_setting(&cohort, &key) {
                    problems.push(format!("{place}: there is no key {key}"));
                }
                continue;
            }
            if !is_setting(&cohort, &key) {
                problems.push(format!("{place}: there is no setting {key}"));
            } else if default == "none" {
                let value = settings.pointer(&format!("/{}", key.replace('.', "/")));
                if value.is_some_and(|value| !value.is_null()) {
                    problems.push(format!("{place}: {key} has the default {value:?}"));
                }
            } else {
                let value = toml::from_str::<Value>(&format!("value = {default}"))
                    .map(|mut parsed| parsed["value"].take());
                match value.map(|value| with(&key, value)) {
                    Ok(Ok(changed)) if changed == usual => {}
                    Ok(Ok(_)) => problems.push(format!(
                        "{place}: {default} is not the default of {key}, {:?} is",
                        settings.pointer(&format!("/{}", key.replace('.', "/")))
                    )),
                    Ok(Err(error)) => problems.push(format!("{place}: {key} = {default}: {error}")),
                    Err(error) => problems.push(format!("{place}: {key} = {default}: {error}")),
                }
            }
        }
    }
    assert!(
        problems.is_empty(),
        "defaults that are not the program's:\n  {}",
        problems.join("\n  ")
    );
    let mut all = BTreeSet::new();
    leaves(&cohort, &cohort, "", &mut all);
    let missing: Vec<&String> = all.difference(&told).collect();
    assert!(missing.is_empty(), "docs/settings.md lacks {missing:?}");
}

/// The ends of a range in words such as `above 0, to 1,000`, `0 to 1` or `0 or more`: values that
/// must be accepted, and values that must be refused.
fn ends(allowed: &str) -> Option<(Vec<f64>, Vec<f64>)> {
    let number = |text: &str| text.trim().replace(',', "").parse::<f64>().ok();
    let beyond = |high: f64| high + 1e-3 * high.abs().max(1.0);
    if let Some(above) = allowed.strip_prefix("above ") {
        let (low, high) = match above.split_once(", to ") {
            Some((low, high)) => (number(low)?, Some(number(high)?)),
            None => (number(above)?, None),
        };
        let accepted = [Some(low + 1e-3), high].into_iter().flatten().collect();
        return Some((
            accepted,
            [Some(low), high.map(beyond)]
                .into_iter()
                .flatten()
                .collect(),
        ));
    }
    if let Some(low) = allowed.strip_suffix(" or more") {
        let low = number(low)?;
        return Some((vec![low], vec![low - 1e-3]));
    }
    let (low, high) = allowed.split_once(" to ")?;
    let (low, high) = (number(low)?, number(high)?);
    Some((vec![low, high], vec![low - 1e-3, beyond(high)]))
}

/// The ranges in the column `allowed` are those that the settings' types state.
#[test]
fn allowed_ranges_are_the_programs() {
    let ranges = Ranges::of::<Settings>();
    let is_accepted = |key: &str, value: f64| {
        with(key, Value::from(value)).is_ok_and(|settings| {
            ranges
                .outside(&settings)
                .iter()
                .all(|found| found.key != key)
        })
    };
    let mut n_ranges = 0;
    let mut problems = Vec::new();
    for file in documents() {
        for Row {
            place,
            key,
            allowed,
            ..
        } in rows(&file)
        {
            let Some((accepted, refused)) = ends(&allowed) else {
                continue;
            };
            // The range of a table of free names is that of the numbers in it.
            if with(&key, Value::Object(Map::new())).is_ok() {
                continue;
            }
            n_ranges += 1;
            for value in accepted
                .into_iter()
                .filter(|value| !is_accepted(&key, *value))
            {
                problems.push(format!(
                    "{place}: {key} = {value} is refused, the page has {allowed}"
                ));
            }
            for value in refused
                .into_iter()
                .filter(|value| is_accepted(&key, *value))
            {
                problems.push(format!(
                    "{place}: {key} = {value} is accepted, the page has {allowed}"
                ));
            }
        }
    }
    assert!(
        problems.is_empty(),
        "ranges that are not the program's:\n  {}",
        problems.join("\n  ")
    );
    assert!(n_ranges > 20, "only {n_ranges} ranges were found");
}

/// The program accepts every value that a page gives to a setting, as in `solver.fidelity =
/// "reduced"` or `--set step1.tolerance=0.02`.
#[test]
fn values_of_settings_are_taken() {
    let value = Regex::new(
        r#"((?:solver|step1|step2|step3|posterior|verification|workflow|executor)(?:\.[A-Za-z_]\w*)+) ?= ?("[^"]*"|\[[^\]]*\]|\{[^}]*\}|[\w.+-]+)"#,
    )
    .expect("a regular expression");
    let mut n_values = 0;
    let mut problems = Vec::new();
    for file in documents() {
        if name_of(&file) == "CHANGELOG.md" {
            continue;
        }
        for (i, line) in read(&file).lines().enumerate() {
            for found in value.captures_iter(line) {
                let (key, text) = (&found[1], &found[2]);
                // A placeholder, such as N.
                if text.chars().all(|c| c.is_ascii_uppercase()) || text.contains('…') {
                    continue;
                }
                n_values += 1;
                let taken = toml::from_str::<Value>(&format!("value = {text}"))
                    .map_or_else(|_| Value::from(text), |mut parsed| parsed["value"].take());
                if let Err(error) = with(key, taken) {
                    problems.push(format!(
                        "{}:{}: {key} = {text}: {error}",
                        file.display(),
                        i + 1
                    ));
                }
            }
        }
    }
    assert!(
        problems.is_empty(),
        "values that the program refuses:\n  {}",
        problems.join("\n  ")
    );
    assert!(n_values > 30, "only {n_values} values were found");
}

/// Paths of all keys of a TOML document. Keys inside the tables of an array count as the array.
fn paths(value: &Value, path: &mut Vec<String>, found: &mut Vec<Vec<String>>) {
    match value {
        Value::Object(table) if !table.is_empty() => {
            for (key, value) in table {
                path.push(key.clone());
                paths(value, path, found);
                path.pop();
            }
        }
        _ => found.push(path.clone()),
    }
}

/// Each block of TOML fits the schema of a cohort's, a patient's, a recording's or a model's file.
#[test]
fn blocks_of_toml_fit_a_schema() {
    // Input of `cardiotwin predict --scenarios`: one table per scenario, under any name.
    const SCENARIOS: [&str; 3] = ["set", "description", "patients"];
    let schemas: Vec<Value> = ["cohort", "patient", "raw", "model"]
        .into_iter()
        .map(schema)
        .collect();
    let cohort = &schemas[0];
    let mut n_blocks = 0;
    let mut problems = Vec::new();
    for file in documents() {
        let text = read(&file);
        for (i, block) in text
            .split("```toml\n")
            .skip(1)
            .filter_map(|rest| rest.split("```").next())
            .enumerate()
        {
            n_blocks += 1;
            let place = format!("{}, block {} of TOML", file.display(), i + 1);
            let parsed: Value = match toml::from_str(block) {
                Ok(parsed) => parsed,
                Err(error) => {
                    problems.push(format!("{place}: {error}"));
                    continue;
                }
            };
            let mut keys = Vec::new();
            paths(&parsed, &mut Vec::new(), &mut keys);
            let fits = |schema: &Value| {
                keys.iter().all(|path| {
                    knows(schema, schema, path)
                        // The settings of a single patient are tables of the cohort.
                        && path.split_first().is_none_or(|(first, rest)| {
                            first != "settings" || knows(cohort, cohort, rest)
                        })
                })
            };
            let is_scenarios = keys
                .iter()
                .all(|path| path.len() == 2 && SCENARIOS.contains(&path[1].as_str()));
            if !is_scenarios && !schemas.iter().any(fits) {
                problems.push(format!("{place} fits no schema: {keys:?}"));
            }
        }
    }
    assert!(
        problems.is_empty(),
        "TOML that no file may hold:\n  {}",
        problems.join("\n  ")
    );
    assert!(n_blocks > 5, "only {n_blocks} blocks of TOML were found");
}
