"""Which effects the residuals support: candidates, covariates, evidence and challenges."""
