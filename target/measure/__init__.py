"""The true size of a box: from what a ruler reads to a corrected target.json."""
