//! A problem of a setting's value, which the checks of the settings return.

/// A problem of a setting's value.
#[derive(Debug, Clone, PartialEq)]
pub struct Complaint {
    /// Dotted key of the setting.
    pub key: String,
    /// A key with which the setting conflicts. If `key` is a built-in default, this is the key that
    /// was set.
    pub against: Option<String>,
    /// Value that was found.
    pub found: String,
    /// Description of valid values.
    pub expected: String,
    /// Advice to the user.
    pub remedy: String,
}
