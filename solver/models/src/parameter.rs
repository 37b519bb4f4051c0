//! A model's parameters with the values that its equations admit. Names in files, units, defaults and their sources are
//! those of [`cardiotwin_vocabulary::cell`].

/// One parameter of a model.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Parameter {
    /// Symbol in the paper, in plain letters.
    pub symbol: &'static str,
    /// Name in files, which ends with the unit where there is one.
    pub name: &'static str,
    /// Values that the equations admit.
    pub domain: Domain,
}

/// Values that a model's equations admit for a parameter.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Domain {
    /// A finite number above zero.
    Positive,
    /// A finite number of zero or more.
    NotNegative,
    /// Between 0 and 1, both excluded.
    Fraction,
    /// Any finite number, of either sign.
    Finite,
}

impl Domain {
    /// Whether `value` is finite and admitted.
    #[must_use]
    pub fn contains(self, value: f64) -> bool {
        value.is_finite()
            && match self {
                Self::Positive => value > 0.0,
                Self::NotNegative => value >= 0.0,
                Self::Fraction => value > 0.0 && value < 1.0,
                Self::Finite => true,
            }
    }

    /// The domain in words, after "must be".
    #[must_use]
    pub fn expected(self) -> &'static str {
        match self {
            Self::Positive => "positive",
            Self::NotNegative => "zero or more",
            Self::Fraction => "between 0 and 1",
            Self::Finite => "finite",
        }
    }
}

/// Declares the struct of a model's parameters with its table: for each field symbol, name in files and domain. Switches are
/// further fields, off by default, that are no numbers.
macro_rules! parameters {
    (
        $(#[$doc:meta])*
        pub struct $name:ident {
            $(
                $(#[$field_doc:meta])*
                $field:ident: $symbol:literal, $file:literal, $domain:ident;
            )+
        }
        $(switches { $( $(#[$switch_doc:meta])* $switch:ident; )+ })?
    ) => {
        $(#[$doc])*
        #[derive(Debug, Clone, Copy, PartialEq, serde::Serialize, serde::Deserialize)]
        pub struct $name {
            $( $(#[$field_doc])* pub $field: f64, )+
            $($( $(#[$switch_doc])* #[serde(default)] pub $switch: bool, )+)?
        }

        impl Default for $name {
            /// Defaults of the vocabulary.
            fn default() -> Self {
                use cardiotwin_vocabulary::cell::constant_of_cell;
                Self {
                    $( $field: const { constant_of_cell($file).default }, )+
                    $($( $switch: false, )+)?
                }
            }
        }

        impl $name {
            /// Every parameter, in the order of the fields.
            pub const TABLE: [$crate::parameter::Parameter; [$($symbol),+].len()] = [
                $(
                    $crate::parameter::Parameter {
                        symbol: $symbol,
                        name: $file,
                        domain: $crate::parameter::Domain::$domain,
                    },
                )+
            ];

            /// The numbers in the order of [`Self::TABLE`].
            #[must_use]
            pub fn values(&self) -> [f64; Self::TABLE.len()] {
                [$(self.$field),+]
            }

            /// From numbers in the order of [`Self::TABLE`]; switches are off.
            #[must_use]
            pub fn from_values(values: [f64; Self::TABLE.len()]) -> Self {
                let [$($field),+] = values;
                Self {
                    $($field,)+
                    $($( $switch: false, )+)?
                }
            }

            /// The first parameter that its domain does not admit, with its value.
            #[must_use]
            pub fn first_outside(&self) -> Option<(&'static $crate::parameter::Parameter, f64)> {
                static TABLE: [$crate::parameter::Parameter; $name::TABLE.len()] = $name::TABLE;
                TABLE
                    .iter()
                    .zip(self.values())
                    .find(|(parameter, value)| !parameter.domain.contains(*value))
            }
        }
    };
}

pub(crate) use parameters;

#[cfg(test)]
mod tests {
    use super::*;
    use crate::calcium::Rice2008Parameters;
    use crate::cell0d::LandPassiveParameters;
    use crate::contraction::Land2017Parameters;

    #[test]
    fn domains_admit_what_they_say() {
        for value in [f64::NAN, f64::INFINITY] {
            assert!(!Domain::Finite.contains(value), "{value}");
        }
        assert!(!Domain::Positive.contains(0.0) && Domain::NotNegative.contains(0.0));
        assert!(!Domain::Fraction.contains(1.0) && Domain::Fraction.contains(0.5));
        assert!(Domain::Finite.contains(-2.4) && !Domain::NotNegative.contains(-2.4));
    }

    #[test]
    fn defaults_lie_in_their_domain() {
        assert_eq!(Land2017Parameters::default().first_outside(), None);
        assert_eq!(LandPassiveParameters::default().first_outside(), None);
        assert_eq!(Rice2008Parameters::default().first_outside(), None);
    }

    #[test]
    fn numbers_return_in_the_order_of_the_table() {
        let values = std::array::from_fn(|i| i as f64);
        let p = Land2017Parameters::from_values(values);
        assert_eq!(p.values(), values);
        assert_eq!((p.k_trpn_per_ms, p.smax_ref_kpa), (0.0, 16.0));
        let (parameter, value) = p.first_outside().unwrap();
        assert_eq!((parameter.symbol, value), ("k_TRPN", 0.0));
    }
}
