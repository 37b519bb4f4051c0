#!/usr/bin/env bash
# Makes the book of README, docs/ and the examples' pages, and checks every link in it. Usage: docs/book/build.sh OUT
# OUT/html/index.html is the book. Needs python3, and mdbook, which cargo builds where there is none (docs/book/mdbook.sh).
set -euo pipefail
cd "$(dirname "$0")/../.."
out=${1:?usage: docs/book/build.sh OUT}

mkdir -p "$out"
program=$(docs/book/mdbook.sh "$(dirname "$out")/tools")
rm -rf -- "$out"
mkdir -p "$out/src/examples" "$out/src/schemas"
cp README.md CONTRIBUTING.md CHANGELOG.md LICENSE-MIT LICENSE-APACHE "$out/src/"
cp -r docs "$out/src/docs"
cp -r schemas/json "$out/src/schemas/json"
for page in examples/*/README.md; do
    mkdir -p "$out/src/$(dirname "$page")"
    cp "$page" "$out/src/$page"
    for file in "$(dirname "$page")"/LICENSE*; do [ ! -e "$file" ] || cp "$file" "$out/src/$file"; done
done
rm -r "$out/src/docs/book"
# The summary is written for docs/; the book begins at the repository's README.
sed -e 's|](\.\./|](@|g' -e 's|](\([^@]\)|](docs/\1|g' -e 's|](@|](|g' "$out/src/docs/SUMMARY.md" >"$out/src/SUMMARY.md"
rm "$out/src/docs/SUMMARY.md"
# mdbook makes index.html of a README.md, but leaves links to it as they are.
find "$out/src" -name '*.md' -exec sed -i 's|](\([^):]*\)README\.md|](\1index.md|g' {} +
find "$out/src" -name README.md | while read -r page; do mv "$page" "$(dirname "$page")/index.md"; done
cp docs/book/book.toml "$out/"
"$program" build "$out"
python3 docs/book/check_links.py "$out/html"
