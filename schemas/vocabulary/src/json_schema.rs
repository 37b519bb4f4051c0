//! Reading of JSON Schemas that are derived from types.

use serde_json::Value;

/// Follows the references of a schema inside `root`, and takes the alternative to `null` of an
/// optional value.
#[must_use]
pub fn resolve<'a>(mut schema: &'a Value, root: &'a Value) -> &'a Value {
    loop {
        let alternatives = schema.get("anyOf").and_then(Value::as_array);
        let real = alternatives.and_then(|all| {
            all.iter()
                .find(|one| one.get("type").and_then(Value::as_str) != Some("null"))
        });
        let name = schema
            .get("$ref")
            .and_then(Value::as_str)
            .and_then(|reference| reference.strip_prefix("#/$defs/"));
        let definition = name.and_then(|name| root.get("$defs").and_then(|all| all.get(name)));
        match real.or(definition) {
            Some(next) => schema = next,
            None => return schema,
        }
    }
}
