"""What an error looks like on the command line."""


def one_sentence(text: str) -> bool:
    lines = text.strip().splitlines()
    return len(lines) == 1 and lines[0].startswith("palpate: ") and "Traceback" not in text
