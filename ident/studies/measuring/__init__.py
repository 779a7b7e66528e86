"""From the files of a modal test to modes and a campaign."""
