//! Writes every JSON Schema into `schemas/json`.

fn main() -> std::io::Result<()> {
    let folder = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("json");
    for (name, schema) in cardiotwin_schemas::json_schemas::all() {
        std::fs::write(
            folder.join(name),
            cardiotwin_schemas::json_schemas::text(&schema),
        )?;
    }
    Ok(())
}
