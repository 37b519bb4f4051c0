"""Every link in a folder of HTML pages leads to a file of it, and to an id on that page: `check_links.py FOLDER`."""
import pathlib
import sys
from html.parser import HTMLParser
from urllib.parse import unquote, urlsplit


class Page(HTMLParser):
    def __init__(self, path):
        super().__init__()
        self.ids, self.links = set(), []
        self.feed(path.read_text(encoding="utf-8"))

    def handle_starttag(self, tag, attributes):
        for name, value in attributes:
            if value is None:
                continue
            if name == "id" or (tag == "a" and name == "name"):
                self.ids.add(value)
            # Scripts and style sheets are the theme's.
            if (tag, name) in (("a", "href"), ("img", "src")):
                self.links.append((value, self.getpos()[0]))


folder = pathlib.Path(sys.argv[1]).resolve()
# All pages once more, with links that are right elsewhere; and the page for what is not found.
pages = {path: Page(path) for path in sorted(folder.rglob("*.html")) if path.name not in ("print.html", "404.html", "toc.html")}
problems, checked = [], 0
for path, page in pages.items():
    for link, line in page.links:
        parts = urlsplit(link)
        if parts.scheme or parts.netloc:
            continue
        checked += 1
        goal = (path.parent / unquote(parts.path)).resolve() if parts.path else path
        if goal.is_dir():
            goal /= "index.html"
        if not goal.is_file() or folder not in goal.parents:
            problems.append(f"{path.relative_to(folder)}:{line}: {link}: no such file")
        elif parts.fragment and goal in pages and unquote(parts.fragment) not in pages[goal].ids:
            problems.append(f"{path.relative_to(folder)}:{line}: {link}: no such heading")
print(f"{len(pages)} pages, {checked} links, {len(problems)} lead nowhere")
print("\n".join(problems))
sys.exit(1 if problems or not checked else 0)
