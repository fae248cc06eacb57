"""The report: report.json, report.html and their pictures."""
