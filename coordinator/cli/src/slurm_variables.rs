//! Variables of Slurm in the caller's shell, which have no effect on submissions.

/// A sentence that names the caller's variables with their values; `None` without any.
#[must_use]
pub fn without_effect() -> Option<String> {
    let of_shell: Vec<(String, String)> = std::env::vars_os()
        .filter_map(|(name, value)| {
            Some((
                name.into_string().ok()?,
                value.to_string_lossy().into_owned(),
            ))
        })
        .collect();
    told(&of_shell)
}

fn told(of_shell: &[(String, String)]) -> Option<String> {
    let names = cardiotwin_engine::without_effect(of_shell.iter().map(|(name, _)| name.as_str()));
    let shown: Vec<String> = names
        .iter()
        .filter_map(|name| {
            let (_, value) = of_shell.iter().find(|(known, _)| known == name)?;
            Some(format!("{name}={value}"))
        })
        .collect();
    (!shown.is_empty()).then(|| {
        format!(
            "{} of this shell: no effect on jobs, which are submitted as their scripts say; set \
             executor.slurm instead",
            shown.join(", ")
        )
    })
}

#[cfg(test)]
mod tests {
    use super::told;

    #[test]
    fn variables_are_named_with_their_values() {
        let of = |pairs: &[(&str, &str)]| {
            let owned: Vec<(String, String)> = pairs
                .iter()
                .map(|(a, b)| ((*a).to_owned(), (*b).to_owned()))
                .collect();
            told(&owned)
        };
        let said = of(&[
            ("SBATCH_PARTITION", "scavenge"),
            ("PATH", "/bin"),
            ("SBATCH_ACCOUNT", "other"),
        ]);
        let said = said.unwrap();
        assert!(
            said.starts_with(
                "SBATCH_ACCOUNT=other, SBATCH_PARTITION=scavenge of this shell: no effect"
            ),
            "{said}"
        );
        assert_eq!(
            of(&[("PATH", "/bin"), ("SLURM_CONF", "/etc/slurm.conf")]),
            None
        );
    }
}
